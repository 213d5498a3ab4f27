"""The generalised pupil function: stop, lens and defocus (thesis Eq. 3.2)."""

from __future__ import annotations

import math

import torch

from optics.accuracy import ErrorEstimate
from optics.camera import Camera, Lens

_EDGE_SAMPLES = 16


def pupil_amplitude(camera: Camera) -> torch.Tensor:
    """Share of each panel pixel that lies inside the lens stop, (rows, columns), float64.

    Edge pixels get their covered area, from 16 x 16 points: a jagged edge would cost
    four times the accuracy.
    """
    y, x = camera.panel.plane.mesh()
    radius, half = camera.lens.stop_diameter / 2, camera.panel.pitch / 2
    far = torch.hypot(y.abs() + half, x.abs() + half)
    near = torch.hypot((y.abs() - half).clamp(min=0), (x.abs() - half).clamp(min=0))
    amplitude = (far <= radius).to(torch.float64)
    edge = (far > radius) & (near < radius)
    if edge.any():
        rows, columns = torch.nonzero(edge, as_tuple=True)
        offset = ((torch.arange(_EDGE_SAMPLES) + 0.5) / _EDGE_SAMPLES - 0.5) * camera.panel.pitch
        offset = offset.to(torch.float64)
        dy = y[rows, 0][:, None, None] + offset[None, :, None]
        dx = x[0, columns][:, None, None] + offset[None, None, :]
        inside = (dy**2 + dx**2 <= radius**2).to(torch.float64)
        amplitude[rows, columns] = inside.mean(dim=(1, 2))
    return amplitude


def open_area(camera: Camera) -> float:
    """Area in square metres that panel and stop both leave open: a circle in a rectangle."""
    radius = camera.lens.stop_diameter / 2
    low, wide = sorted(0.5 * n * camera.panel.pitch for n in camera.panel.shape)
    flat = min(wide, math.sqrt(max(radius**2 - low**2, 0.0)))

    def under_arc(x: float) -> float:
        return 0.5 * (x * math.sqrt(radius**2 - x**2) + radius**2 * math.asin(x / radius))

    return 4 * (low * flat + under_arc(min(wide, radius)) - under_arc(min(flat, radius)))


def require_light(distance: float, wavelength: float) -> None:
    """Raise ValueError for an object or a wavelength that sends no light through a lens."""
    if not distance > 0:
        raise ValueError(f"distance is {distance:g} m; the object must be in front of the camera")
    if not 0 < wavelength < math.inf:
        raise ValueError(f"wavelength is {wavelength:g} m; it must be positive")


def paraxial_error(lens: Lens) -> ErrorEstimate:
    """What the paraxial model leaves out: of the order of the steepest ray's squared sine."""
    sine = 0.5 * lens.stop_diameter / lens.image_distance
    return ErrorEstimate(sine**2, "estimate: paraxial")


def cutoff_frequency(camera: Camera, wavelength: float) -> float:
    """The finest fringe of the light on the sensor, in cycles per metre."""
    width = min(camera.lens.stop_diameter, max(camera.panel.shape) * camera.panel.pitch)
    return width / (wavelength * camera.lens.image_distance)


def vergence_error(lens: Lens, distance: float) -> float:
    """1/d + 1/z - 1/f in dioptres: zero when an object at `distance` metres is in focus."""
    return 1 / distance - 1 / lens.focus_distance


def defocus_phase(camera: Camera, distance: float, wavelength: float) -> torch.Tensor:
    """Phase in radians over the panel of an object off the plane in focus, float64.

    The spherical wave of the object, the thin lens (thesis Eq. 2.14) and the wave that
    converges on the sensor, in the paraxial approximation; exactly zero in focus.
    """
    y, x = camera.panel.plane.mesh()
    return defocus_curvature(camera.lens, distance, wavelength) * (y**2 + x**2)


def defocus_curvature(lens: Lens, distance: float, wavelength: float) -> float:
    """Radians of defocus per square metre from the axis."""
    return math.pi / wavelength * vergence_error(lens, distance)


def _reach(camera: Camera) -> float:
    """Metres from the axis to the edge of the open pupil, at the most."""
    corner = math.hypot(*(n * camera.panel.pitch for n in camera.panel.shape))
    return 0.5 * min(camera.lens.stop_diameter, corner)


def blur_radius(camera: Camera, distance: float) -> float:
    """Radius in metres on the sensor of a defocused point, by geometric optics."""
    lens = camera.lens
    return _reach(camera) * abs(vergence_error(lens, distance)) * lens.image_distance


def phase_step(camera: Camera, distance: float, wavelength: float) -> float:
    """The largest change of defocus phase across one panel pixel, in radians."""
    curvature = abs(defocus_curvature(camera.lens, distance, wavelength))
    return 2 * curvature * _reach(camera) * camera.panel.pitch
