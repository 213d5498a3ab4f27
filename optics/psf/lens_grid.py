"""Choose the band of the panel's frequencies and the grid at the lens that keep a tolerance.

How far light goes sideways before it meets the stop limits both. They give the axes of the
propagator from panel to lens: FFT lengths, and samples at the lens.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from optics.accuracy import ToleranceError, unreachable_tolerance_error
from optics.camera import Camera
from optics.plane import Plane
from optics.psf.edge_scatter import StopEdgeScatter, fresnel_area, is_in_band, stop_extent
from optics.psf.request import PSFRequest
from optics.psf.to_lens import PropagatorAxis, TaperedBand, fast_fft_length

Array = NDArray[np.float64]

TAPER_TOL_SHARE = 1e-2
"""Share of the tolerance that smooth ends of a band may change within the area that the light
reaches. Chosen."""

# Share of the tolerance that the smooth ends of a band may leave outside the area that its light
# reaches by geometric optics. Chosen.
_OUTSIDE_TOL_SHARE = 1e-2

# Width in which the light of a band's ends decays, as a share of the widths of panel and stop
# together. A larger one takes longer FFTs, a smaller one wider ends of the band. Chosen.
_MARGIN_SHARE = 0.05

_MARGIN_ZONES = 2.0  # addition to that width, in Fresnel zones; chosen

# Candidate sampling rates of the lens grid, over the band's half width. The search takes the
# lowest rate that keeps the tolerance.
_GRID_REFINEMENTS = (
    *np.arange(1.25, 2, 0.125),
    *np.arange(2, 4, 0.25),
    *(4, 5, 6, 8, 12, 16, 24, 32, 48, 64),
)

# Candidate shares of the lost light that the limits of a band along y may cause; those along x
# cause the rest.
_SPLITS = np.linspace(0.05, 0.95, 13)

# Candidate shares of the tolerance for the frequencies outside the band. The search takes the
# share that gives the smallest grid.
_BAND_TOL_SHARES = (0.3, 0.5, 0.7)

# Step of the logarithm of the frequency in which light is summed. Sorting the light itself takes
# five times as long.
_LOG_FREQUENCY_STEP = 0.005


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
        steps = math.sqrt(2 * math.log(1 / min(_OUTSIDE_TOL_SHARE * q.tol, 1e-3)))
        return BandTaper(margin, steps / (2 * math.pi * margin), steps)

    @property
    def width(self) -> float:
        return self.sigmas * self.sigma


def choose_lens_grid(
    request: PSFRequest, camera: Camera, search: LensGridSearch, tol: float
) -> LensGrid:
    """Choose the cheapest lens grid and frequency band with a relative error of `tol`.

    The error has two parts. The first comes from panel frequencies outside the band, whose light
    the stop's edge scatters into the window (see StopEdgeScatter). The second comes from the
    sampled edge of the stop: a cell of the grid that the edge cuts passes light in proportion to
    its open area. The edge then scatters too little, by the sinc of its shift in frequency over the
    sampling rate, and aliasing along either or both axes of the grid adds light to the window.

    Raises ToleranceError if no grid keeps the tolerance.
    """
    taper_width = np.array([BandTaper.for_axis(request, camera, axis).width for axis in (0, 1)])
    grids = []
    for share in _BAND_TOL_SHARES:
        grid = search.find_coarsest_grid(share * tol, tol, taper_width)
        grids += [] if grid is None else [grid]
    if not grids:
        raise unreachable_tolerance_error(tol, 2 * tol)
    return min(grids, key=lambda grid: math.prod(grid.sampling_rate))


def _edge_transmission(turns: Array) -> Array:
    """Return the share of the scattered field that the sampled edge of the stop keeps.

    turns: shift in frequency, in cycles per sample of the lens grid, (..., 2).
    """
    return np.asarray(np.sinc(turns).prod(-1))


class LensGridSearch:
    """Searches the band and the lens grid that neglect little of the light from a stop's edge."""

    def __init__(self, edge: StopEdgeScatter) -> None:
        self.edge_scatter = edge

    @cached_property
    def without_limit(self) -> LensGridSearch:
        """The same search among all light between panel and stop, however oblique."""
        return LensGridSearch(self.edge_scatter.without_limit())

    @cached_property
    def _nonzero_scatter(self) -> tuple[Array, Array, NDArray[np.int64]]:
        """The light of all scattered rays that aren't dark.

        The arrays hold each ray's light, its frequency at the panel, and the index of the shift in
        frequency that the stop's edge gives it.
        """
        rays = self.edge_scatter.scattered_rays
        seen = rays.light > 0
        edge, _, distance = np.nonzero(seen)
        turn = edge * self.edge_scatter.edge_frequency_shift.shape[2] + distance
        return rays.light[seen], rays.frequency[seen], turn

    @cached_property
    def _light_outside_band(self) -> list[tuple[Array, Array]]:
        light, frequency, _ = self._nonzero_scatter
        return self._cumulative_light_by_side(frequency, light)

    @cached_property
    def _unbounded_light_outside_band(self) -> list[tuple[Array, Array]]:
        rays = self.edge_scatter.scattered_rays
        return self._cumulative_light_by_side(
            rays.frequency.reshape(-1, 2), rays.unbounded_light.ravel()
        )

    def _cumulative_light_by_side(
        self, frequency: Array, light: Array
    ) -> list[tuple[Array, Array]]:
        """Sum the panel's light outside the passing band, on each side along each axis."""
        (low, high), zone = self.edge_scatter.passing_band, self.edge_scatter.fresnel_zone_frequency
        return [
            _cumulative_light_outwards(sign * frequency[:, axis], light, float(end), zone)
            for axis in (0, 1)
            for sign, end in ((-1, -low[axis]), (1, high[axis]))
        ]

    def find_coarsest_grid(
        self, allowed_error: float, tol: float, taper_width: Array
    ) -> LensGrid | None:
        """Find the coarsest lens grid that keeps `tol` with the narrowest frequency band, if any.

        allowed_error: error that the frequencies outside the band may cause.
        taper_width: width of the band's smooth ends on either side, cycles per metre (y, x).
        """
        edge = self.edge_scatter
        low, high, outside = self._narrowest_band(allowed_error, taper_width)
        turned = self._light_by_edge_shift(low, high)
        base = np.maximum(np.abs(low), np.abs(high)) / edge.shadow_magnification
        base = base + edge.max_window_frequency
        lit = np.flatnonzero(turned)
        shift, turned = edge.edge_frequency_shift.reshape(-1, 2)[lit], turned[lit]

        def lost_light(finer: float) -> float:
            passed = _edge_transmission(shift / (finer * base))
            return outside + float(turned @ (1 - passed) ** 2)

        # Light in the band is shifted by less than `base`, but for aberrations, so that finer grids
        # lose less. Each that is taken is checked below.
        first = bisect_left(
            _GRID_REFINEMENTS, True, key=lambda finer: edge.relative_error(lost_light(finer)) <= tol
        )
        for finer in _GRID_REFINEMENTS[first:]:
            rate, lost = finer * base, lost_light(finer)
            passed = _edge_transmission(edge.edge_frequency_shift / rate)
            error = edge.relative_error(lost + _aliased_light(edge, low, high, rate, passed))
            if error <= tol:
                band_low, band_high, rates = (tuple(one.tolist()) for one in (low, high, rate))
                return LensGrid(band_low, band_high, rates, error)
        return None

    def _light_by_edge_shift(self, low: Array, high: Array) -> Array:
        """Sum the light in a band for each frequency shift that the stop's edge gives."""
        light, frequency, turn = self._nonzero_scatter
        inside = is_in_band(frequency, low, high)
        count = self.edge_scatter.edge_frequency_shift[..., 0].size
        return np.asarray(np.bincount(turn[inside], light[inside], count), dtype=np.float64)

    def passing_error_share(self, grid: LensGrid) -> float:
        """Return the share of the squared grid error that comes from the passing band."""
        edge, rate = self.edge_scatter, np.array(grid.sampling_rate)
        low, high = edge.passing_band
        passed = _edge_transmission(edge.edge_frequency_shift / rate)
        lost = float(self._light_by_edge_shift(low, high) @ (1 - passed.ravel()) ** 2)
        lost += _aliased_light(edge, low, high, rate, passed)
        return min(1.0, (edge.relative_error(lost) / grid.error) ** 2) if grid.error else 0.0

    def _narrowest_band(self, allowed: float, taper_width: Array) -> tuple[Array, Array, float]:
        """Find the narrowest frequency band, (low, high), and the light outside it.

        Rays neglect that light spreads over a Fresnel zone, so the band is widened by a zone. It
        isn't made wider than the band of an infinitely large panel, which needs no such margin.
        """
        low, high = self.find_band(allowed, taper_width)
        light, frequency, _ = self._nonzero_scatter
        outside = float(light[~is_in_band(frequency, low, high)].sum())
        least, most = self.find_band(allowed, taper_width, unbounded_panel=True)
        zone = self.edge_scatter.fresnel_zone_frequency
        wide = low - zone, high + zone
        low = np.maximum(wide[0], np.minimum(low, least))
        high = np.minimum(wide[1], np.maximum(high, most))
        if (low > wide[0]).any() or (high < wide[1]).any():
            rays = self.edge_scatter.scattered_rays
            outside = float(rays.unbounded_light[~is_in_band(rays.frequency, low, high)].sum())
        return low, high, outside

    def find_band(
        self, error: float, taper_width: Array, *, unbounded_panel: bool = False
    ) -> tuple[Array, Array]:
        """Find the smallest band whose neglected light causes at most a relative error.

        The result is (low, high), each (y, x), in cycles per metre.

        unbounded_panel: whether light counts as if the panel were infinitely large.
        """
        sides = self._unbounded_light_outside_band if unbounded_panel else self._light_outside_band
        lost = self.edge_scatter.allowed_light_loss(error)
        least_low, least_high = self.edge_scatter.passing_band
        bands = []
        for split in _SPLITS:
            shares = (split, split, 1 - split, 1 - split)
            down, up, left, right = (
                _cutoff_for_lost_light(*side, lost * share / 2)
                for side, share in zip(sides, shares, strict=True)
            )
            low = np.minimum([-down, -left], least_low - taper_width)
            bands.append((low, np.maximum([up, right], least_high + taper_width)))
        return min(bands, key=lambda band: float(np.prod(band[1] - band[0])))


def _cumulative_light_outwards(
    frequency: Array, light: Array, end: float, zone: float
) -> tuple[Array, Array]:
    """Return frequencies beyond the end of a band, the farthest first, and the light beyond each.

    The frequencies are in steps of half a percent of the distance from the end plus a Fresnel zone.
    """
    step = _LOG_FREQUENCY_STEP
    away = np.log1p(np.maximum(frequency - end, 0.0) / zone)
    steps = math.ceil(float(away.max(initial=0.0)) / step)
    number = np.minimum((away / step).astype(np.int64), steps)
    outwards = np.cumsum(np.bincount(number, light, steps + 1)[::-1])
    reached = end + zone * np.expm1(step * np.arange(steps + 1, 0, -1))
    return reached, outwards.astype(np.float64)


def _cutoff_for_lost_light(frequency: Array, light: Array, lost: float) -> float:
    """Return the frequency beyond which no more than the light `lost` is scattered."""
    place = int(np.searchsorted(light, lost))
    return float(frequency[place]) if place < frequency.size else -math.inf


def _aliased_light(
    edge: StopEdgeScatter, low: Array, high: Array, rate: Array, passed: Array
) -> float:
    """Sum the light that aliasing on the lens grid adds to the window in 8 directions."""
    ways = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1))
    return sum(edge.aliased_light(np.array(way) * rate, low, high, passed) for way in ways)


def tapered_band(low: float, high: float, fresnel_area: float, tol: float) -> TaperedBand:
    """Return a band of panel frequencies whose smooth ends leave low to high unchanged.

    Light of the frequency f moves sideways by f times the Fresnel area A. Against the chirp
    exp(-i pi A (f - f0)²), a Gaussian step of standard deviation s at the distance D from the
    stationary frequency f0 leaves exp(-2 (pi A s D)² / (1 + (2 pi A s²)²)). The best s² is 1 / (2
    pi A), which leaves exp(-pi A D² / 2). The same holds for a step in the light's way sideways.
    """
    steps = math.sqrt(2 * math.log(1 / (TAPER_TOL_SHARE * tol)))
    room = steps / math.sqrt(math.pi * fresnel_area)
    return TaperedBand(low - room, high + room, 1 / math.sqrt(2 * math.pi * fresnel_area), steps)


def limited_reach(
    search: LensGridSearch, fresnel_area: float, error: float, tol: float
) -> tuple[TaperedBand, TaperedBand]:
    """Return the bands (y, x) of light that must be followed to keep a relative error.

    A pixel sends light of the frequency f to places in the stop that lie f times the Fresnel area
    beside it, so the bands say how far each pixel's light must be followed sideways. What is left
    out reaches the window only by way of the stop's edge (see StopEdgeScatter).

    error: relative L2 error behind an evenly lit panel.
    tol: what the bands' smooth ends may not matter to.
    """
    low, high = search.without_limit.find_band(error, np.zeros(2))
    bands = [tapered_band(low[k], high[k], fresnel_area, tol) for k in (0, 1)]
    return bands[0], bands[1]


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
