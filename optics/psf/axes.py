"""Plan the axes of the propagator from panel to lens: FFT lengths and samples at the lens."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from optics.accuracy import ToleranceError
from optics.camera import Camera
from optics.plane import Plane
from optics.psf.request import PSFRequest
from optics.psf.to_lens import PropagatorAxis, TaperedBand, fast_fft_length

_TAPER_TOL_SHARE = 1e-2
"""Share of the tolerance that the smooth ends of a band may leave outside the area that its light
reaches by geometric optics. Chosen."""

_MARGIN_SHARE = 0.05
"""Width in which the light of a band's ends decays, as a share of the widths of panel and stop
together. A larger one takes longer FFTs, a smaller one wider ends of the band. Chosen."""

_MARGIN_ZONES = 2.0  # addition to that width, in Fresnel zones; chosen


@dataclass(frozen=True)
class LensGrid:
    """Holds the band of frequencies at the panel and the sampling rate at the lens, (y, x).

    low, high: cycles per metre.
    sampling_rate: samples per metre at the lens, at least.
    error: estimated relative L2 error behind an evenly lit panel.
    """

    low: tuple[float, float]
    high: tuple[float, float]
    sampling_rate: tuple[float, float]
    error: float


@dataclass(frozen=True)
class BandTaper:
    """Describes how smoothly a band of frequencies ends along an axis, by a Gaussian step.

    margin: metres at the panel in which the light of the band's ends decays.
    sigma: standard deviation of the Gaussian, cycles per metre; its impulse response falls as
    exp(-2 (pi sigma margin)²).
    sigmas: number of standard deviations at which the band counts as zero.
    """

    margin: float
    sigma: float
    sigmas: float

    @staticmethod
    def for_axis(q: PSFRequest, camera: Camera, axis: int) -> BandTaper:
        low, high = stop_extent(camera, axis)
        wide = (high - low) * q.radius + camera.panel.shape[axis] * camera.panel.pitch
        margin = _MARGIN_SHARE * wide + _MARGIN_ZONES * math.sqrt(fresnel_area(q))
        steps = math.sqrt(2 * math.log(1 / min(_TAPER_TOL_SHARE * q.tol, 1e-3)))
        return BandTaper(margin, steps / (2 * math.pi * margin), steps)

    @property
    def width(self) -> float:
        return self.sigmas * self.sigma


def fresnel_area(q: PSFRequest) -> float:
    """Return the Fresnel area of the space between panel and lens, in m².

    On the way, light moves sideways by its frequency times this area, in the panel's coordinates.
    """
    return float(q.wavelength * q.separation / q.shadow_magnification)


def plan_propagator_axes(
    request: PSFRequest, camera: Camera, grid: LensGrid, lengths: Sequence[int] = (0, 0)
) -> list[PropagatorAxis]:
    """Plan the axes (y, x) of the propagator from panel to lens grid.

    The grid covers the lit part of the stop.

    lengths: least number of FFT points along each axis.
    """
    return [_plan_axis(request, camera, grid, axis, lengths[axis]) for axis in (0, 1)]


def _plan_axis(
    q: PSFRequest, camera: Camera, grid: LensGrid, axis: int, shortest: int
) -> PropagatorAxis:
    panel, bend, end = camera.panel, fresnel_area(q), BandTaper.for_axis(q, camera, axis)
    ends, (low, high) = panel_and_stop_ends(q, camera, axis)
    band = TaperedBand(grid.low[axis], grid.high[axis], end.sigma, end.sigmas)
    # `reach` is where light of the band arrives at the lens, in the panel's coordinates.
    reach = ends[0] + bend * band.outer_limits[0], ends[1] + bend * band.outer_limits[1]
    low, high = max(low, reach[0] - end.margin), min(high, reach[1] + end.margin)
    if not high > low:
        raise ToleranceError(
            "no light of the panel gets to the stop by geometric optics",
            "ask for a field nearer to the axis, or a panel nearer to the lens",
        )
    least = max(reach[1] - low, high - reach[0], ends[1] - ends[0]) + end.margin
    length = fast_fft_length(max(least / panel.pitch, shortest))
    period = length * panel.pitch
    fold = fast_fft_length(period * grid.sampling_rate[axis] * float(q.shadow_magnification))
    step = period / fold
    # One more cell at either end holds the partly covered cells at the stop's edge.
    count = min(math.ceil((high - low) / step) + 2, fold)
    first = (low + high) / 2 - count // 2 * step
    return PropagatorAxis(
        panel.shape[axis], panel.pitch, panel.active_side, length, count, fold, bend, first, band
    )


def panel_and_stop_ends(
    q: PSFRequest, camera: Camera, axis: int
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the ends of the panel, and of the stop's opening as the panel's shadow meets it.

    Both are in metres along an axis of the panel.
    """
    line, half = camera.panel.plane.coordinates(axis), camera.panel.pitch / 2
    shift = float(q.chief_ray_slopes[axis]) * q.separation
    spread = float(q.shadow_magnification)
    low, high = (edge * q.radius / spread - shift for edge in stop_extent(camera, axis))
    return (float(line[0]) - half, float(line[-1]) + half), (low, high)


def stop_extent(camera: Camera, axis: int) -> tuple[float, float]:
    """Return the lowest and highest coordinate of the stop's opening, in stop radii."""
    t = np.linspace(0, 1, 257)
    opening = camera.lens.stop.loops[0]
    places = np.concatenate([piece.points(t)[axis] for piece in opening.pieces])
    return float(places.min()), float(places.max())


def lens_plane(request: PSFRequest, axes: list[PropagatorAxis]) -> Plane:
    """Return the plane of the propagator's samples at the lens, in metres."""
    spread = float(request.shadow_magnification)
    centre = [
        spread
        * (
            axis.first_sample_position
            + axis.sample_count // 2 * axis.step
            + float(sine) * request.separation
        )
        for axis, sine in zip(axes, request.chief_ray_slopes, strict=True)
    ]
    y, x = axes
    return Plane(
        (y.sample_count, x.sample_count), (y.step * spread, x.step * spread), (centre[0], centre[1])
    )
