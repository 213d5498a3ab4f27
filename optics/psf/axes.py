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


@dataclass(frozen=True)
class PropagatorAxisSettings:
    """Tune the margins of the FFTs from panel to lens.

    taper_tol_share: share of the tolerance that the smooth ends of a band may leave outside the
    area that its light reaches by geometric optics. Chosen.
    margin_share: width in which the light of a band's ends decays, as a share of the widths of
    panel and stop together. A larger margin takes longer FFTs, a smaller one wider ends of the
    band. Chosen.
    margin_zones: addition to that width, in Fresnel zones. Chosen.
    """

    taper_tol_share: float = 1e-2
    margin_share: float = 0.05
    margin_zones: float = 2.0


_SETTINGS = PropagatorAxisSettings()


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
        zones = _SETTINGS.margin_zones * math.sqrt(fresnel_area(q))
        margin = _SETTINGS.margin_share * wide + zones
        steps = math.sqrt(2 * math.log(1 / min(_SETTINGS.taper_tol_share * q.tol, 1e-3)))
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
    panel, spread, bend = camera.panel, float(q.shadow_magnification), fresnel_area(q)
    line = panel.plane.coordinates(axis)
    ends = float(line[0]) - panel.pitch / 2, float(line[-1]) + panel.pitch / 2
    end = BandTaper.for_axis(q, camera, axis)
    band = TaperedBand(grid.low[axis], grid.high[axis], end.sigma, end.sigmas)
    # `reach` is where light of the band arrives at the lens, and low to high is where the stop is
    # open, both in the panel's coordinates.
    reach = ends[0] + bend * band.outer_limits[0], ends[1] + bend * band.outer_limits[1]
    shift = float(q.chief_ray_slopes[axis]) * q.separation
    low, high = (edge * q.radius / spread - shift for edge in stop_extent(camera, axis))
    low, high = max(low, reach[0] - end.margin), min(high, reach[1] + end.margin)
    if not high > low:
        raise ToleranceError(
            "no light of the panel gets to the stop by geometric optics",
            "ask for a field nearer to the axis, or a panel nearer to the lens",
        )
    least = max(reach[1] - low, high - reach[0], ends[1] - ends[0]) + end.margin
    length = fast_fft_length(max(least / panel.pitch, shortest))
    period = length * panel.pitch
    fold = fast_fft_length(period * grid.sampling_rate[axis] * spread)
    step = period / fold
    # One more cell at either end holds the partly covered cells at the stop's edge.
    count = min(math.ceil((high - low) / step) + 2, fold)
    first = (low + high) / 2 - count // 2 * step
    return PropagatorAxis(
        panel.shape[axis], panel.pitch, panel.active_side, length, count, fold, bend, first, band
    )


def stop_extent(camera: Camera, axis: int) -> tuple[float, float]:
    """Return the lowest and highest coordinate of the stop's opening, in stop radii."""
    t = np.linspace(0, 1, 257)
    opening = camera.lens.stop.loops[0]
    places = np.concatenate([piece.points(t)[axis] for piece in opening.pieces])
    return float(places.min()), float(places.max())


def lens_plane(request: PSFRequest, axes: list[PropagatorAxis]) -> Plane:
    """Return the plane of the propagator's samples at the lens, in metres."""
    spread = float(request.shadow_magnification)
    pitch = [axis.step * spread for axis in axes]
    centre = [
        (
            axis.first_sample_position
            + axis.sample_count // 2 * axis.step
            + float(sine) * request.separation
        )
        * spread
        for axis, sine in zip(axes, request.chief_ray_slopes, strict=True)
    ]
    return Plane(
        (axes[0].sample_count, axes[1].sample_count), (pitch[0], pitch[1]), (centre[0], centre[1])
    )
