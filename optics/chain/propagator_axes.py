"""The axes of a propagator to the lens: how long its FFTs are, and where its samples lie at the
lens."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from optics.accuracy import ToleranceError
from optics.camera import Camera
from optics.chain.panel_to_lens import PropagatorAxis, TaperedBand, fast_fft_length
from optics.plane import Plane
from optics.point.request import PSFRequest

_TAPER_TOL_SHARE = 1e-2
"""What a band's smooth ends leave of its light outside the light's geometric reach, in shares
of the tolerance."""

_MARGIN, _ZONES = 0.05, 2.0
"""For the light of a band's ends to die away: of the panel and the stop together, and in
Fresnel zones. A larger margin costs longer FFTs, a smaller one wider ends."""


@dataclass(frozen=True)
class LensGrid:
    """Frequencies at the panel and samples in the lens' plane, along y and x.

    low, high: cycles per metre. sampling_rate: samples per metre at the lens, at least. error:
    relative L2 of the intensity behind an evenly lit panel, an estimate.
    """

    low: tuple[float, float]
    high: tuple[float, float]
    sampling_rate: tuple[float, float]
    error: float


@dataclass(frozen=True)
class BandTaper:
    """How a band ends along an axis.

    margin: metres at the panel in which the light of its ends dies away. sigma: the Gaussian's
    standard deviation, cycles per metre; its impulse response falls as
    exp(-2 (pi sigma margin)²). sigmas: of sigma until nothing is left.
    """

    margin: float
    sigma: float
    sigmas: float

    @staticmethod
    def for_axis(q: PSFRequest, camera: Camera, axis: int) -> BandTaper:
        low, high = stop_extent(camera, axis)
        wide = (high - low) * q.radius + camera.panel.shape[axis] * camera.panel.pitch
        margin = _MARGIN * wide + _ZONES * math.sqrt(fresnel_area(q))
        steps = math.sqrt(2 * math.log(1 / min(_TAPER_TOL_SHARE * q.tol, 1e-3)))
        return BandTaper(margin, steps / (2 * math.pi * margin), steps)

    @property
    def width(self) -> float:
        return self.sigmas * self.sigma


def fresnel_area(q: PSFRequest) -> float:
    """Square metres by which a frequency moves light from panel to lens, at the panel."""
    return float(q.wavelength * q.separation / q.shadow_magnification)


def plan_propagator_axes(
    request: PSFRequest, camera: Camera, grid: LensGrid, lengths: Sequence[int] = (0, 0)
) -> list[PropagatorAxis]:
    """The propagator's axes to a grid that covers what is lit of the stop.

    lengths: FFT points along each axis, at least.
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
    # Where light of the band gets to, and where the stop is open, in the panel's coordinates.
    reach = ends[0] + bend * band.outer_limits[0], ends[1] + bend * band.outer_limits[1]
    shift = float(q.chief_ray_slopes[axis]) * q.separation
    low, high = (edge * q.radius / spread - shift for edge in stop_extent(camera, axis))
    low, high = max(low, reach[0] - end.margin), min(high, reach[1] + end.margin)
    if not high > low:
        raise ToleranceError(
            "no light of the panel gets to the stop by geometric optics; ask for a field nearer "
            "to the axis, or a panel nearer to the lens"
        )
    least = max(reach[1] - low, high - reach[0], ends[1] - ends[0]) + end.margin
    length = fast_fft_length(max(least / panel.pitch, shortest))
    period = length * panel.pitch
    fold = fast_fft_length(period * grid.sampling_rate[axis] * spread)
    step = period / fold
    # A cell to spare at either end, for a gray edge.
    count = min(math.ceil((high - low) / step) + 2, fold)
    first = (low + high) / 2 - count // 2 * step
    return PropagatorAxis(
        panel.shape[axis], panel.pitch, panel.active_side, length, count, fold, bend, first, band
    )


def stop_extent(camera: Camera, axis: int) -> tuple[float, float]:
    """Lowest and highest place of the stop's opening along an axis, in stop radii."""
    t = np.linspace(0, 1, 257)
    opening = camera.lens.stop.loops[0]
    places = np.concatenate([piece.points(t)[axis] for piece in opening.pieces])
    return float(places.min()), float(places.max())


def lens_plane(request: PSFRequest, axes: list[PropagatorAxis]) -> Plane:
    """The propagator's samples as a plane at the lens, metres."""
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
