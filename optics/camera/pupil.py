"""The wave in a lens' stop, and the stop as a panel before the lens sees it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import torch

from optics.accuracy import ErrorEstimate
from optics.caching import byte_limited_cache
from optics.camera import Camera, Lens, Panel
from optics.camera.stop import Stop
from optics.camera.stop_areas import Coverage, coverage
from optics.camera.stop_nodes import PhaseSlopeBound
from optics.fourier.differentiation import apply_function
from optics.plane import Plane
from optics.validation import (
    as_number,
    needs_gradient,
    require_number,
    require_size,
    require_wavelength,
    to_plain_numbers,
)
from optics.zernike import zernike

Scalar = Any
"""A number, or a 0-d tensor in which the result is differentiable."""

MIN_RAY_MATRIX_B_SHARE = 2 / 3
"""Smallest ray matrix element B, as a share of the image distance; a smaller one would need
samples too fine to be worth their cost."""

# Factor on sampled phase slopes, which might be steeper between the samples; chosen.
_SLOPE_MARGIN = 1.1


def pupil_amplitude(camera: Camera) -> torch.Tensor:
    """Compute each panel pixel's share inside the stop, (rows, columns), float64.

    With a jagged edge instead, the error would be four times as large. The tensor is cached, so
    don't write into it. It is differentiable twice in the stop's diameter.
    """
    return _open_shares(camera.lens.stop, camera.lens.stop_diameter / 2, camera.panel.plane)


def open_area(camera: Camera) -> Scalar:
    """Compute the area in m² that panel and stop leave open, as if they stood in one plane.

    It is a number, or a tensor that is differentiable twice in the stop's diameter if that is one.
    """
    lens, whole = camera.lens, _panel_as_one_cell(camera.panel)
    share = _open_shares(lens.stop, lens.stop_diameter / 2, whole)[0, 0]
    area = share * (whole.pitch[0] * whole.pitch[1])
    return area if needs_gradient(area) else float(area)


def _panel_as_one_cell(panel: Panel, shift: tuple[float, float] = (0.0, 0.0)) -> Plane:
    """Return a panel's area as the one cell of a plane, displaced by a shift (y, x) in metres."""
    (height, width), p = (n * panel.pitch for n in panel.shape), panel.pitch
    # The origin is at n // 2, so that an even number of pixels isn't centred on it.
    y, x = ((n % 2 - 1) * p / 2 + way for n, way in zip(panel.shape, shift, strict=True))
    return Plane((1, 1), (height, width), (y, x))


def _open_shares(stop: Stop, radius: Scalar, plane: Plane) -> torch.Tensor:
    """Compute the share of each cell of a plane that a stop leaves open; radius in metres."""
    if not needs_gradient(radius):
        return _cached_shares(stop, as_number(radius), plane, 0)
    shares: torch.Tensor = apply_function(_OpenShares, radius, stop, plane, 0)
    return shares


# 64 MiB hold three pupils of a panel of 1920 x 1080 pixels, or one of 3840 x 2160.
@byte_limited_cache(64 << 20)
def _cached_shares(stop: Stop, radius: float, plane: Plane, order: int) -> torch.Tensor:
    """Compute the open shares, or their derivative in the radius of order 1 or 2."""
    if order == 0:
        return coverage(stop, radius, plane)
    if order == 1:
        return Coverage(stop, radius, plane).radius_derivative()
    # Between radii at which the stop's boundary meets the cells' corners it is smooth.
    step = 1e-6 * radius
    wider, narrower = (
        Coverage(stop, radius + change, plane).radius_derivative() for change in (step, -step)
    )
    return (wider - narrower) / (2 * step)


class _OpenShares(torch.autograd.Function):
    """The open shares as a function of the radius, or their derivative of the order given."""

    @staticmethod
    def forward(
        ctx: Any, radius: torch.Tensor, stop: Stop, plane: Plane, order: int
    ) -> torch.Tensor:
        ctx.asked = stop, plane, order + 1
        ctx.save_for_backward(radius)
        # What is cached must not become part of a graph.
        return _cached_shares(stop, float(radius), plane, order).detach()

    @staticmethod
    def backward(ctx: Any, gradient: torch.Tensor) -> Any:
        (radius,) = ctx.saved_tensors
        if ctx.asked[-1] > 2:
            raise NotImplementedError(
                "the light that a stop lets through can be differentiated twice in its diameter; "
                "take differences of its second derivatives"
            )
        change: torch.Tensor = apply_function(_OpenShares, radius, *ctx.asked)
        return (gradient * change).sum().to(radius), None, None, None


def require_open_pupil(camera: Camera) -> None:
    """Raise ValueError if the stop passes no light of the panel."""
    if not open_area(camera) > 0:
        raise ValueError(
            "the stop or what obscures it covers the whole panel: no light passes; open it "
            f"(f_number is {camera.lens.f_number:g}), or give a larger panel"
        )


def require_valid_source(distance: Scalar, wavelength: Scalar) -> None:
    """Raise an error unless an object's distance and a wavelength are positive lengths."""
    require_number("distance", distance, "m")
    require_number("wavelength", wavelength, "m")
    distance = as_number(distance)
    if not distance > 0:
        raise ValueError(f"distance is {distance:g} m; the object must be in front of the camera")
    if distance < math.inf:
        require_size("object_distance", "distance", distance)
    require_wavelength("wavelength", wavelength)
    if distance < as_number(wavelength):
        raise ValueError(
            f"distance is {distance:g} m, less than a wavelength, where no lens forms an image; "
            "give the object's distance in metres"
        )


def model_error(lens: Lens, wavelength: float, radius: float) -> ErrorEstimate:
    """Estimate how far the lens' wave is from scalar diffraction by an ideal lens.

    The parabola of a thin lens differs from the sphere by r⁴/8z³ of path. Both kinds of lens leave
    out the obliquity of the steepest rays. radius: metres from the axis to the farthest light.
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
    """Return the larger one of `cutoff_frequencies`, in cycles per metre on the sensor."""
    return max(cutoff_frequencies(optics, wavelength))


def cutoff_frequencies(optics: Camera | Lens, wavelength: float) -> tuple[float, float]:
    """Compute the optical cut-offs along y and x, in cycles per metre on the sensor.

    A pixel that the stop cuts counts with its whole width. Behind a panel that stands apart from
    the lens the whole stop is lit.
    """
    lens = optics if isinstance(optics, Lens) else optics.lens
    widths = (lens.stop_diameter, lens.stop_diameter)
    if isinstance(optics, Camera):
        pitch = optics.panel.pitch
        stop = lens.stop_diameter + 2 * pitch
        rows, columns = (min(stop, count * pitch) for count in optics.panel.shape)
        widths = (rows, columns)
        if optics.separation:
            lever = max(optics.ray_matrix_b / lens.image_distance, MIN_RAY_MATRIX_B_SHARE)
            widest = max(stop, max(rows, columns) / lever)
            widths = (widest, widest)
    y, x = (width / (wavelength * lens.image_distance) for width in widths)
    return y, x


def object_to_lens_distance(camera: Camera, distance: Scalar) -> Scalar:
    """Return the distance from the lens to an object `distance` metres before the panel."""
    return distance + camera.separation


def vergence_error(lens: Lens, distance: Scalar) -> Scalar:
    """Compute 1/d + 1/z - 1/f in dioptres for an object at the distance d; zero in focus."""
    return 1 / distance - 1 / lens.focus_distance


def defocus_curvature(lens: Lens, distance: Scalar, wavelength: Scalar) -> Scalar:
    """Compute the paraxial phase of defocus, radians per square metre of r²."""
    return math.pi / wavelength * vergence_error(lens, distance)


def defocus_path(lens: Lens, distance: Scalar, r2: torch.Tensor) -> torch.Tensor:
    """Compute the optical path of defocus in metres, r2 square metres from the axis in the pupil.

    The path is the sum of the object's spherical wave, the lens, and the wave that converges on the
    sensor. It is quadratic for a thin lens (thesis Eq. 2.14), and a difference of two spheres for a
    stigmatic one, in a form that loses no digits. In focus it is exactly zero.
    """
    if lens.kind == "thin":
        return vergence_error(lens, distance) / 2 * r2
    return _sag(1 / distance, r2) - _sag(1 / lens.focus_distance, r2)


def _sag(vergence: Scalar, r2: torch.Tensor) -> torch.Tensor:
    """Compute the sag sqrt(d² + r²) - d of a sphere for d = 1 / vergence, also infinite d."""
    return r2 * vergence / (1 + torch.sqrt(1 + r2 * vergence**2))


def pupil_phase(
    lens: Lens, distance: Scalar, wavelength: Scalar, y: torch.Tensor, x: torch.Tensor
) -> torch.Tensor:
    """Compute the phase of a point's light in the stop in radians (thesis Eq. 3.2), float64.

    y, x: in units of the stop's radius; they broadcast.
    """
    r2 = (y**2 + x**2) * (lens.stop_diameter / 2) ** 2
    path = defocus_path(lens, distance, r2)
    for n, m, strength in lens.aberrations:
        path = path + strength * zernike(n, m, y, x)
    return 2 * math.pi / wavelength * path


def pupil_phase_on_panel(camera: Camera, distance: Scalar, wavelength: Scalar) -> torch.Tensor:
    """Compute the phase at the panel's pixel centres, (rows, columns), in radians."""
    radius = camera.lens.stop_diameter / 2
    y, x = camera.panel.plane.mesh()
    return pupil_phase(camera.lens, distance, wavelength, y / radius, x / radius)


def phase_slope_bound(
    lens: Lens, distance: float, wavelength: float, tilt: float
) -> PhaseSlopeBound:
    """Bound how fast the phase in the stop changes, for the choice of quadrature nodes.

    The bound is analytic for pure defocus, and else found from samples along rays and circles.
    tilt: the slope that belongs to the farthest image sample.
    """
    radius = lens.stop_diameter / 2
    if not lens.aberrations:
        edge = torch.tensor(radius**2, dtype=torch.float64)
        slope = 4 * math.pi / wavelength * float(defocus_path(lens, distance, edge).abs())
        # The defocus of a stigmatic lens is at most a fifth steeper than the parabola with the
        # same value at the edge, at the numerical apertures that such a lens has.
        spare = 1.0 if lens.kind == "thin" else 1.2
        return PhaseSlopeBound(lambda r: spare * slope * r, lambda r: 0.0, tilt)
    finest = max(n for n, _, _ in lens.aberrations)
    r = torch.linspace(0, 1, 33 + 16 * finest, dtype=torch.float64)
    angle = torch.linspace(0, 2 * math.pi, 33 + 16 * finest, dtype=torch.float64)
    y, x = r[:, None] * torch.sin(angle), r[:, None] * torch.cos(angle)
    phase = pupil_phase(lens, distance, wavelength, y, x)
    along = (torch.diff(phase, dim=0).abs().amax(1) / (r[1] - r[0])).numpy()
    across = (torch.diff(phase, dim=1).abs().amax(1) / (angle[1] - angle[0])).numpy()
    # A weak polynomial of high degree isn't steep, but needs enough nodes all the same: 20 radians
    # per stop radius are added for each degree beyond the fourth.
    along = _SLOPE_MARGIN * np.maximum.accumulate(along) + 20.0 * max(finest - 4, 0)
    across = _SLOPE_MARGIN * np.maximum.accumulate(across)
    middles = ((r[1:] + r[:-1]) / 2).numpy()
    return PhaseSlopeBound(
        lambda q: float(np.interp(q, middles, along)),
        lambda q: float(np.interp(q, r.numpy(), across)),
        tilt,
        max(1, *(abs(m) for _, m, _ in lens.aberrations)),
    )


def open_pupil_radius(camera: Camera) -> float:
    """Return the largest distance from the axis to light in the stop, in metres."""
    return min(camera.lens.stop_diameter / 2, panel_half_diagonal(camera))


def panel_half_diagonal(camera: Camera) -> float:
    """Return the distance from the axis to the panel's corner, in metres."""
    return math.hypot(*(n * camera.panel.pitch for n in camera.panel.shape)) / 2


def phase_step_per_pixel(camera: Camera, distance: float, wavelength: float) -> float:
    """Compute the largest change of the phase across an open panel pixel, in radians."""
    lens, panel = to_plain_numbers(camera.lens), camera.panel
    radius = lens.stop_diameter / 2
    if not lens.aberrations:
        # A pixel that the stop cuts reaches beyond the stop.
        reach = min(radius + math.sqrt(2) * panel.pitch, panel_half_diagonal(camera)) / radius
        bound = phase_slope_bound(lens, distance, wavelength, 0.0)
        return bound.largest_slope(reach) / radius * panel.pitch
    # The phase between the pixels' corners. Only pixels that are at least partly open count,
    # because Zernike polynomials grow fast beyond the stop.
    y, x = (
        (torch.arange(n + 1, dtype=torch.float64) - n // 2 - 0.5) * (panel.pitch / radius)
        for n in panel.shape
    )
    phase = pupil_phase(lens, distance, wavelength, y[:, None], x[None, :])
    is_open = pupil_amplitude(replace(camera, lens=lens)) > 0
    down, along = phase.diff(dim=0).abs(), phase.diff(dim=1).abs()
    down = torch.maximum(down[:, 1:], down[:, :-1])[is_open]
    along = torch.maximum(along[1:], along[:-1])[is_open]
    if not down.numel():
        return 0.0
    return _SLOPE_MARGIN * float((down**2 + along**2).max().sqrt())


def numeric_camera(camera: Camera) -> Camera:
    """Return the camera with plain numbers in place of its lens' and separation's tensors."""
    return replace(
        camera, lens=to_plain_numbers(camera.lens), separation=as_number(camera.separation)
    )


def panel_to_focus_distance(camera: Camera) -> float:
    """Return the distance from the panel to the plane in focus, in metres.

    Raises ValueError for a panel in that plane or beyond it, whose pixels the lens would image.
    """
    distance = camera.lens.focus_distance - camera.separation
    if not distance > 0:
        raise ValueError(
            f"separation is {camera.separation:g} m; the panel must stand between the lens and "
            f"the plane in focus, {camera.lens.focus_distance:g} m before it"
        )
    return distance


def with_stop_shadow_on_panel(camera: Camera) -> Camera:
    """Return the camera with its stop on the panel, as large as its shadow there.

    Light of a point in focus, d metres before the panel, spreads by the factor 1 + separation / d
    on its way to the stop, so that the light that passes comes from an area on the panel that is
    smaller by this factor. This is geometric optics; diffraction blurs the shadow's rim over
    sqrt(wavelength separation). The returned camera is valid for its panel, its stop and their open
    area, but not for lengths behind the lens. It is the given camera if panel and lens are in one
    plane. Raises ValueError under the same conditions as panel_to_focus_distance().
    """
    if not camera.separation:
        return camera
    spread = 1 + camera.separation / panel_to_focus_distance(camera)
    lens = replace(camera.lens, f_number=camera.lens.f_number * spread)
    return replace(camera, lens=lens, separation=0.0)


def share_through_stop(camera: Camera, distance: float, field: tuple[float, float]) -> float:
    """Compute the share of a point's light on the panel that passes the lens, by geometric optics.

    distance: metres from the point to the panel, math.inf allowed.
    field: metres (y, x) on the sensor from the axis to the point's image.

    As in a PSF, the share is relative to the light that panel and stop would both pass if they
    stood in one plane. The ray through the middle of the lens has the slope field / image distance
    and meets the panel at -separation times this slope, in the middle of the stop's shadow. Light
    that a pattern deflects isn't considered. Raises ValueError for a stop and a panel without
    common area.
    """
    whole = open_area(camera)
    if not whole:
        raise ValueError("the panel and the stop have no area in common; no light passes")
    lens, z1 = camera.lens, as_number(camera.separation)
    radius = as_number(lens.stop_diameter) / 2 / (1 + z1 / distance)
    y, x = (z1 * place / as_number(lens.image_distance) for place in field)
    panel = _panel_as_one_cell(camera.panel, (y, x))
    return float(coverage(lens.stop, radius, panel)) * panel.pitch[0] * panel.pitch[1] / whole
