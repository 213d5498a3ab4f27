"""Which frequencies of the panel's light have to be followed to the lens, and how fine a grid
there has to be."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from optics.accuracy import unreachable_tolerance_error
from optics.camera import Camera
from optics.chain.edge_scatter import StopEdgeScatter, is_in_band
from optics.chain.propagator_axes import BandTaper, LensGrid
from optics.point.request import PSFRequest

Array = NDArray[np.float64]

_BAND_TOL_SHARES = (0.3, 0.5, 0.7)
"""Shares of the tolerance that frequencies left out may take; the cheapest is chosen."""

_GRID_REFINEMENTS = (
    *np.arange(1.25, 2, 0.125),
    *np.arange(2, 4, 0.25),
    4,
    5,
    6,
    8,
    12,
    16,
    24,
    32,
    48,
    64,
)
"""Of the grid, over the band's half: the coarsest that keeps its part is taken."""

_LOG_FREQUENCY_STEP = 0.005
"""Of the logarithm of frequencies, in which light is added up."""

_SPLITS = np.linspace(0.05, 0.95, 13)


def choose_lens_grid(
    request: PSFRequest, camera: Camera, search: LensGridSearch, tol: float
) -> LensGrid:
    """The cheapest band and grid that leave a relative error of `tol`.

    Light of the frequencies left out, of which the window gets what the stop's edge scatters,
    is the first part of the error (see StopEdgeScatter). The second is that of the stop's gray
    edge: a cell of the grid that the edge cuts passes light by its open area, so the edge scatters
    sinc of its turn in frequency over the rate, which is too little, and also what one and two
    directions of the grid's own frequencies turn back.

    Raises ToleranceError if no grid does.
    """
    soft = np.array([BandTaper.for_axis(request, camera, axis).width for axis in (0, 1)])
    chosen: LensGrid | None = None
    for share in _BAND_TOL_SHARES:
        found = search.find_coarsest_grid(share * tol, tol, soft)
        if found is not None and (chosen is None or _grid_size(found) < _grid_size(chosen)):
            chosen = found
    if chosen is None:
        raise unreachable_tolerance_error(tol, 2 * tol)
    return chosen


def _grid_size(grid: LensGrid) -> float:
    return grid.sampling_rate[0] * grid.sampling_rate[1]


def _pair(values: Array) -> tuple[float, float]:
    return float(values[0]), float(values[1])


def _edge_transmission(turns: Array) -> Array:
    """What a gray edge leaves of the light that it turns, by the cycles a sample (..., 2)."""
    return np.asarray(np.sinc(turns).prod(axis=-1))


def _missing_scatter(turned: Array, passed: Array) -> float:
    """Light that a gray edge fails to turn, of what each turn takes."""
    return float(turned @ (1 - passed.ravel()) ** 2)


class LensGridSearch:
    """What bands and grids leave out, of one edge's light."""

    def __init__(self, edge: StopEdgeScatter) -> None:
        self.edge_scatter = edge

    @cached_property
    def _nonzero_scatter(self) -> tuple[Array, Array, NDArray[np.int64]]:
        """Light that there is: how much, its frequency at the panel, and which of the edge's
        turns it takes."""
        rays = self.edge_scatter.scattered_rays
        seen = rays.light > 0
        edge, _, distance = np.nonzero(seen)
        turn = edge * self.edge_scatter.edge_frequency_shift.shape[2] + distance
        return rays.light[seen], rays.frequency[seen], turn

    @cached_property
    def _light_outside_band(self) -> list[tuple[Array, Array]]:
        light, frequency, _ = self._nonzero_scatter
        return _cumulative_light_by_side(
            frequency,
            light,
            self.edge_scatter.passing_band,
            self.edge_scatter.fresnel_zone_frequency,
        )

    @cached_property
    def _unbounded_light_outside_band(self) -> list[tuple[Array, Array]]:
        rays = self.edge_scatter.scattered_rays
        frequency, light = rays.frequency.reshape(-1, 2), rays.unbounded_light.ravel()
        return _cumulative_light_by_side(
            frequency,
            light,
            self.edge_scatter.passing_band,
            self.edge_scatter.fresnel_zone_frequency,
        )

    def find_coarsest_grid(
        self, allowed_error: float, tol: float, taper_width: Array
    ) -> LensGrid | None:
        """The coarsest grid for the narrowest band that leaves out no more than is allowed.

        taper_width: cycles per metre (y, x) that the band's smooth ends take at either side.
        """
        edge = self.edge_scatter
        low, high, out = self._narrowest_band(allowed_error, taper_width)
        turned = self._light_by_edge_shift(low, high)
        base = (
            np.maximum(np.abs(low), np.abs(high)) / edge.shadow_magnification
            + edge.max_window_frequency
        )
        for finer in _GRID_REFINEMENTS:
            rate = finer * base
            passed = _edge_transmission(edge.edge_frequency_shift / rate)
            lost = out + _missing_scatter(turned, passed)
            if edge.relative_error(lost) > tol:
                continue
            error = edge.relative_error(lost + _aliased_light(edge, low, high, rate, passed))
            if error <= tol:
                return LensGrid(_pair(low), _pair(high), _pair(rate), error)
        return None

    def _light_by_edge_shift(self, low: Array, high: Array) -> Array:
        """Light of a band, by which of the edge's turns it takes."""
        light, frequency, turn = self._nonzero_scatter
        inside = is_in_band(frequency, low, high)
        count = self.edge_scatter.edge_frequency_shift[..., 0].size
        return np.asarray(np.bincount(turn[inside], light[inside], count), dtype=np.float64)

    def passing_error_share(self, grid: LensGrid) -> float:
        """Share of a grid's squared error that light makes whose frequencies pass the stop."""
        edge, rate = self.edge_scatter, np.array(grid.sampling_rate)
        low, high = edge.passing_band
        passed = _edge_transmission(edge.edge_frequency_shift / rate)
        lost = _missing_scatter(self._light_by_edge_shift(low, high), passed)
        lost += _aliased_light(edge, low, high, rate, passed)
        return min(1.0, (edge.relative_error(lost) / grid.error) ** 2) if grid.error else 0.0

    def _narrowest_band(self, allowed: float, soft: Array) -> tuple[Array, Array, float]:
        """The narrowest band, low and high, and the light that it leaves out.

        Rays don't know that light spreads over a Fresnel zone, so a zone is added; but not
        beyond the band of light from anywhere, for which that makes no difference.
        """
        low, high = self.find_band(allowed, soft)
        light, frequency, _ = self._nonzero_scatter
        out = float(light[~is_in_band(frequency, low, high)].sum())
        least, most = self.find_band(allowed, soft, unbounded_panel=True)
        wide = (
            low - self.edge_scatter.fresnel_zone_frequency,
            high + self.edge_scatter.fresnel_zone_frequency,
        )
        low = np.maximum(wide[0], np.minimum(low, least))
        high = np.minimum(wide[1], np.maximum(high, most))
        if (low > wide[0]).any() or (high < wide[1]).any():
            rays = self.edge_scatter.scattered_rays
            out = float(rays.unbounded_light[~is_in_band(rays.frequency, low, high)].sum())
        return low, high, out

    def find_band(
        self, error: float, taper_width: Array, *, unbounded_panel: bool = False
    ) -> tuple[Array, Array]:
        """The smallest (low, high), each (y, x), that leaves out no more than an error.

        unbounded_panel: of light from anywhere, on the panel or beside it.
        """
        ordered = (
            self._unbounded_light_outside_band if unbounded_panel else self._light_outside_band
        )
        lost = self.edge_scatter.allowed_light_loss(error)
        least_low, least_high = self.edge_scatter.passing_band
        best: tuple[Array, Array] | None = None
        for split in _SPLITS:
            parts = (split, split, 1 - split, 1 - split)
            sides = [
                _cutoff_for_lost_light(*one, lost * share / 2)
                for one, share in zip(ordered, parts, strict=True)
            ]
            low = np.minimum([-sides[0], -sides[2]], least_low - taper_width)
            high = np.maximum([sides[1], sides[3]], least_high + taper_width)
            if best is None or np.prod(high - low) < np.prod(best[1] - best[0]):
                best = low, high
        assert best is not None
        return best


def _cumulative_light_by_side(
    frequency: Array, light: Array, ends: tuple[Array, Array], zone: float
) -> list[tuple[Array, Array]]:
    """Light beyond the ends (low, high) of a band, to each side along each axis."""
    low, high = ends
    found = []
    for axis in (0, 1):
        for sign, end in ((-1, -low[axis]), (1, high[axis])):
            found.append(
                _cumulative_light_outwards(sign * frequency[:, axis], light, float(end), zone)
            )
    return found


def _cumulative_light_outwards(
    frequency: Array, light: Array, end: float, zone: float
) -> tuple[Array, Array]:
    """Frequencies beyond an end, the farthest first, and the light from there on outwards.

    In steps of half a percent of a frequency's distance from the end, and of a zone: sorting
    the light itself takes five times as long.
    """
    away = np.log1p(np.maximum(frequency - end, 0.0) / zone)
    steps = math.ceil(float(away.max(initial=0.0)) / _LOG_FREQUENCY_STEP)
    number = np.minimum((away / _LOG_FREQUENCY_STEP).astype(np.int64), steps)
    outwards = np.cumsum(np.bincount(number, light, steps + 1)[::-1])
    reached = end + zone * np.expm1(_LOG_FREQUENCY_STEP * np.arange(steps + 1, 0, -1))
    return reached, outwards.astype(np.float64)


def _cutoff_for_lost_light(frequency: Array, light: Array, lost: float) -> float:
    """Beyond which frequency no more light than that is scattered."""
    place = int(np.searchsorted(light, lost))
    return float(frequency[place]) if place < frequency.size else -math.inf


def _aliased_light(
    edge: StopEdgeScatter, low: Array, high: Array, rate: Array, passed: Array
) -> float:
    """Light that gets into the window's middle by the grid's own frequencies."""
    ways = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1))
    return sum(edge.aliased_light(np.array(way) * rate, low, high, passed) for way in ways)
