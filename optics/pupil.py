"""The generalised pupil function: stop, lens and defocus (thesis Eq. 3.2)."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import torch

from optics.accuracy import ErrorEstimate
from optics.caching import byte_limited_cache
from optics.camera import Camera, Lens
from optics.plane import Plane
from optics.stop.aperture import Stop
from optics.stop.coverage import coverage
from optics.stop.quadrature import PhaseSlopeBound
from optics.validation import as_number, to_plain_numbers
from optics.zernike import zernike

Scalar = Any
"""A number or a 0-d tensor in which the answer is differentiable."""

MIN_RAY_MATRIX_B_SHARE = 2 / 3
"""Of the image distance: a shorter lever than that needs samples too fine to be worth it."""

_SLOPE_MARGIN = 1.1
"""Slopes are sampled, and might be steeper in between."""

_SLOPE_PER_ZERNIKE_DEGREE = 20.0
"""Radians per stop radius for each degree of an aberration beyond the fourth."""

_AMPLITUDE_CACHE_BYTES = 64 << 20
"""Bytes of pupils that are kept: three of a panel of 1920 x 1080 pixels, or one of 3840 x 2160."""


def pupil_amplitude(camera: Camera) -> torch.Tensor:
    """Share of each panel pixel that lies inside the lens stop, (rows, columns), float64.

    Edge pixels get their covered area: a jagged edge would cost four times the accuracy.
    Don't write into it: it is kept.
    """
    lens = camera.lens
    return _cached_pupil_amplitude(lens.stop, lens.focal_length, lens.f_number, camera.panel.plane)


@byte_limited_cache(_AMPLITUDE_CACHE_BYTES)
def _cached_pupil_amplitude(
    stop: Stop, focal_length: float, f_number: float, plane: Plane
) -> torch.Tensor:
    return coverage(stop, focal_length / f_number / 2, plane)


def open_area(camera: Camera) -> float:
    """Area in square metres that panel and stop both leave open, as if they stood in one plane."""
    panel = camera.panel
    whole = tuple(n * panel.pitch for n in panel.shape)
    # Of an even number of pixels, one more lies below the origin than above it.
    middle = tuple((n % 2 - 1) * panel.pitch / 2 for n in panel.shape)
    one = Plane((1, 1), (whole[0], whole[1]), (middle[0], middle[1]))
    share = coverage(camera.lens.stop, camera.lens.stop_diameter / 2, one)
    return float(share) * whole[0] * whole[1]


def require_open_pupil(camera: Camera) -> None:
    """Raise ValueError for a stop that leaves the panel dark."""
    if not open_area(camera) > 0:
        raise ValueError(
            "the stop or what obscures it covers the whole panel: no light passes; open it "
            f"(f_number is {camera.lens.f_number:g}), or give a larger panel"
        )


def require_valid_source(distance: float, wavelength: float) -> None:
    """Raise ValueError for an object or a wavelength that sends no light through a lens."""
    if not distance > 0:
        raise ValueError(f"distance is {distance:g} m; the object must be in front of the camera")
    if not 0 < wavelength < math.inf:
        raise ValueError(f"wavelength is {wavelength:g} m; it must be positive")


def model_error(lens: Lens, wavelength: float, radius: float) -> ErrorEstimate:
    """What the lens model leaves out of scalar diffraction by an ideal lens.

    A thin, quadratic lens is short of the sphere by r⁴/8z³ of path. Both kinds are short of
    the obliquity of the steepest rays. radius: metres from the axis to the farthest light.
    """
    z = lens.image_distance
    sine = radius / z
    if lens.kind == "stigmatic":
        return ErrorEstimate(sine**2, "estimate: obliquity of the rays, a scalar wave")
    waves = radius**4 / (8 * z**3) / wavelength
    return ErrorEstimate(
        min(1.0, sine**2 + waves / 4), "estimate: paraxial, a quadratic thin lens, a scalar wave"
    )


def cutoff_frequency(optics: Camera | Lens, wavelength: float) -> float:
    """The finest fringe of the light on the sensor, in cycles per metre.

    A pixel that the stop cuts is as wide as the others, and reaches beyond it. Behind a panel
    that stands apart from the lens the whole stop is lit.
    """
    lens = optics if isinstance(optics, Lens) else optics.lens
    width = lens.stop_diameter
    if isinstance(optics, Camera):
        pitch = optics.panel.pitch
        open_width = min(width + 2 * pitch, max(optics.panel.shape) * pitch)
        if not optics.separation:
            width = open_width
        else:
            lever = max(optics.ray_matrix_b / lens.image_distance, MIN_RAY_MATRIX_B_SHARE)
            width = max(width + 2 * pitch, open_width / lever)
    return width / (wavelength * lens.image_distance)


def object_to_lens_distance(camera: Camera, distance: Scalar) -> Scalar:
    """Metres from the lens to an object that is `distance` metres before the panel."""
    return distance + camera.separation


def vergence_error(lens: Lens, distance: Scalar) -> Scalar:
    """1/d + 1/z - 1/f in dioptres: zero when an object at `distance` metres is in focus."""
    return 1 / distance - 1 / lens.focus_distance


def defocus_curvature(lens: Lens, distance: Scalar, wavelength: Scalar) -> Scalar:
    """Radians of defocus per square metre from the axis, in the paraxial approximation."""
    return math.pi / wavelength * vergence_error(lens, distance)


def defocus_path(lens: Lens, distance: Scalar, r2: torch.Tensor) -> torch.Tensor:
    """Metres of optical path, at r2 square metres from the axis, of an object off the focus.

    The object's spherical wave, the lens, and the wave that converges on the sensor:
    quadratic for a thin lens (thesis Eq. 2.14), a difference of two spheres for a stigmatic
    one, in a form that loses no digits; exactly zero in focus.
    """
    if lens.kind == "thin":
        return vergence_error(lens, distance) / 2 * r2
    return _sag(1 / distance, r2) - _sag(1 / lens.focus_distance, r2)


def _sag(vergence: Scalar, r2: torch.Tensor) -> torch.Tensor:
    """sqrt(d² + r²) - d for d = 1 / vergence, infinity included."""
    return r2 * vergence / (1 + torch.sqrt(1 + r2 * vergence**2))


def pupil_phase(
    lens: Lens, distance: Scalar, wavelength: Scalar, y: torch.Tensor, x: torch.Tensor
) -> torch.Tensor:
    """Phase in radians of a point's light in the pupil (thesis Eq. 3.2), float64.

    y, x: in units of the stop's radius; they broadcast. Defocus and aberrations.
    """
    r2 = (y**2 + x**2) * (lens.stop_diameter / 2) ** 2
    path = defocus_path(lens, distance, r2)
    for n, m, strength in lens.aberrations:
        path = path + strength * zernike(n, m, y, x)
    return 2 * math.pi / wavelength * path


def pupil_phase_on_panel(camera: Camera, distance: Scalar, wavelength: Scalar) -> torch.Tensor:
    """pupil_phase() at the panel's pixel centres, (rows, columns)."""
    radius = camera.lens.stop_diameter / 2
    y, x = camera.panel.plane.mesh()
    return pupil_phase(camera.lens, distance, wavelength, y / radius, x / radius)


def phase_slope_bound(
    lens: Lens, distance: float, wavelength: float, tilt: float
) -> PhaseSlopeBound:
    """How fast a lens' wave turns over its stop; tilt: that of the farthest image sample.

    Analytic for pure defocus; with aberrations from samples along rays and circles.
    """
    radius = lens.stop_diameter / 2
    if not lens.aberrations:
        edge = torch.tensor(radius**2, dtype=torch.float64)
        slope = 4 * math.pi / wavelength * float(defocus_path(lens, distance, edge).abs())
        # A stigmatic lens' defocus is no steeper than the parabola that ends where it ends
        # by more than a fifth, at the numerical apertures that such a lens has.
        spare = 1.0 if lens.kind == "thin" else 1.2
        return PhaseSlopeBound(lambda r: spare * slope * r, lambda r: 0.0, tilt)
    finest = max(n for n, _, _ in lens.aberrations)
    r = torch.linspace(0, 1, 33 + 16 * finest, dtype=torch.float64)
    angle = torch.linspace(0, 2 * math.pi, 33 + 16 * finest, dtype=torch.float64)
    y, x = r[:, None] * torch.sin(angle), r[:, None] * torch.cos(angle)
    phase = pupil_phase(lens, distance, wavelength, y, x)
    along = (torch.diff(phase, dim=0).abs().amax(1) / (r[1] - r[0])).numpy()
    across = (torch.diff(phase, dim=1).abs().amax(1) / (angle[1] - angle[0])).numpy()
    # A weak polynomial of high degree is not steep, and has to be followed all the same.
    along = _SLOPE_MARGIN * np.maximum.accumulate(along) + _SLOPE_PER_ZERNIKE_DEGREE * max(
        finest - 4, 0
    )
    across = _SLOPE_MARGIN * np.maximum.accumulate(across)
    middles = ((r[1:] + r[:-1]) / 2).numpy()
    return PhaseSlopeBound(
        lambda q: float(np.interp(q, middles, along)),
        lambda q: float(np.interp(q, r.numpy(), across)),
        tilt,
        max(1, *(abs(m) for _, m, _ in lens.aberrations)),
    )


def open_pupil_radius(camera: Camera) -> float:
    """Metres from the axis to the edge of the open pupil, at the most."""
    return min(camera.lens.stop_diameter / 2, panel_half_diagonal(camera))


def panel_half_diagonal(camera: Camera) -> float:
    """Metres from the axis to the panel's corner."""
    return math.hypot(*(n * camera.panel.pitch for n in camera.panel.shape)) / 2


def phase_step_per_pixel(camera: Camera, distance: float, wavelength: float) -> float:
    """The largest change of the lens' wave across one open panel pixel, in radians."""
    lens, panel = to_plain_numbers(camera.lens), camera.panel
    radius = lens.stop_diameter / 2
    if lens.aberrations:
        return _SLOPE_MARGIN * _largest_pixel_phase_step(
            replace(camera, lens=lens), distance, wavelength
        )
    # A pixel that the stop cuts reaches beyond it.
    reach = min(radius + math.sqrt(2) * panel.pitch, panel_half_diagonal(camera)) / radius
    return (
        phase_slope_bound(lens, distance, wavelength, 0.0).largest_slope(reach)
        / radius
        * panel.pitch
    )


def _largest_pixel_phase_step(camera: Camera, distance: float, wavelength: float) -> float:
    """From corner to corner of the pixels that the stop leaves open in part: polynomials grow
    fast beyond it."""
    panel, radius = camera.panel, camera.lens.stop_diameter / 2
    y, x = (
        (torch.arange(n + 1, dtype=torch.float64) - n // 2 - 0.5) * (panel.pitch / radius)
        for n in panel.shape
    )
    phase = pupil_phase(camera.lens, distance, wavelength, y[:, None], x[None, :])
    is_open = pupil_amplitude(camera) > 0
    down, along = phase.diff(dim=0).abs(), phase.diff(dim=1).abs()
    down = torch.maximum(down[:, 1:], down[:, :-1])[is_open]
    along = torch.maximum(along[1:], along[:-1])[is_open]
    return float((down**2 + along**2).max().sqrt()) if down.numel() else 0.0


def numeric_camera(camera: Camera) -> Camera:
    """A camera whose lens and separation are plain numbers."""
    return replace(
        camera, lens=to_plain_numbers(camera.lens), separation=as_number(camera.separation)
    )
