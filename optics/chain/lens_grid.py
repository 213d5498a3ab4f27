"""Which frequencies of the panel's light have to be followed to the lens, and how fine a grid
there has to be."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from optics.accuracy import unkeepable
from optics.camera import Camera
from optics.chain.edge_light import EdgeLight, between
from optics.chain.relay_axes import End, LensGrid
from optics.point.question import Question

Array = NDArray[np.float64]

_LEFT_OUT = (0.3, 0.5, 0.7)
"""Shares of the tolerance that frequencies left out may take; the cheapest is chosen."""

_FINER = (*np.arange(1.25, 2, 0.125), *np.arange(2, 4, 0.25), 4, 5, 6, 8, 12, 16, 24, 32, 48, 64)
"""Of the grid, over the band's half: the coarsest that keeps its part is taken."""

_STEP = 0.005
"""Of the logarithm of frequencies, in which light is added up."""

_SPLITS = np.linspace(0.05, 0.95, 13)


def lens_grid(question: Question, camera: Camera, search: Search, tol: float) -> LensGrid:
    """The cheapest band and grid that leave a relative error of `tol`.

    Light of the frequencies left out, of which the window gets what the stop's edge scatters,
    is the first part of the error (see EdgeLight). The second is that of the stop's gray edge:
    a cell of the grid that the edge cuts passes light by its open area, so the edge scatters
    sinc of its turn in frequency over the rate, which is too little, and also what one and two
    directions of the grid's own frequencies turn back.

    Raises ToleranceError if no grid does.
    """
    soft = np.array([End.of(question, camera, axis).width for axis in (0, 1)])
    chosen: LensGrid | None = None
    for share in _LEFT_OUT:
        found = search.coarsest(share * tol, tol, soft)
        if found is not None and (chosen is None or _size(found) < _size(chosen)):
            chosen = found
    if chosen is None:
        raise unkeepable(tol, 2 * tol)
    return chosen


def _size(grid: LensGrid) -> float:
    return grid.rate[0] * grid.rate[1]


def _pair(values: Array) -> tuple[float, float]:
    return float(values[0]), float(values[1])


def _passed(turns: Array) -> Array:
    """What a gray edge leaves of the light that it turns, by the cycles a sample (..., 2)."""
    return np.asarray(np.sinc(turns).prod(axis=-1))


def _not_passed(turned: Array, passed: Array) -> float:
    """Light that a gray edge fails to turn, of what each turn takes."""
    return float(turned @ (1 - passed.ravel()) ** 2)


class Search:
    """What bands and grids leave out, of one edge's light."""

    def __init__(self, edge: EdgeLight) -> None:
        self.edge = edge

    @cached_property
    def _seen(self) -> tuple[Array, Array, NDArray[np.int64]]:
        """Light that there is: how much, its frequency at the panel, and which of the edge's
        turns it takes."""
        rays = self.edge.scattered
        seen = rays.light > 0
        edge, _, distance = np.nonzero(seen)
        turn = edge * self.edge.across.shape[2] + distance
        return rays.light[seen], rays.frequency[seen], turn

    @cached_property
    def _outward(self) -> list[tuple[Array, Array]]:
        light, frequency, _ = self._seen
        return _four_ways(frequency, light, self.edge.passing, self.edge.zone)

    @cached_property
    def _outward_anywhere(self) -> list[tuple[Array, Array]]:
        rays = self.edge.scattered
        frequency, light = rays.frequency.reshape(-1, 2), rays.anywhere.ravel()
        return _four_ways(frequency, light, self.edge.passing, self.edge.zone)

    def coarsest(self, allowed: float, tol: float, soft: Array) -> LensGrid | None:
        """The coarsest grid for the narrowest band that leaves out no more than is allowed.

        soft: cycles per metre (y, x) that the band's smooth ends take at either side.
        """
        edge = self.edge
        low, high, out = self._followed(allowed, soft)
        turned = self._turned(low, high)
        base = np.maximum(np.abs(low), np.abs(high)) / edge.spread + edge.reach
        for finer in _FINER:
            rate = finer * base
            passed = _passed(edge.across / rate)
            lost = out + _not_passed(turned, passed)
            if edge.relative(lost) > tol:
                continue
            error = edge.relative(lost + _turned_back(edge, low, high, rate, passed))
            if error <= tol:
                return LensGrid(_pair(low), _pair(high), _pair(rate), error)
        return None

    def _turned(self, low: Array, high: Array) -> Array:
        """Light of a band, by which of the edge's turns it takes."""
        light, frequency, turn = self._seen
        inside = between(frequency, low, high)
        count = self.edge.across[..., 0].size
        return np.asarray(np.bincount(turn[inside], light[inside], count), dtype=np.float64)

    def within(self, grid: LensGrid) -> float:
        """Share of a grid's squared error that light makes whose frequencies pass the stop."""
        edge, rate = self.edge, np.array(grid.rate)
        low, high = edge.passing
        passed = _passed(edge.across / rate)
        lost = _not_passed(self._turned(low, high), passed)
        lost += _turned_back(edge, low, high, rate, passed)
        return min(1.0, (edge.relative(lost) / grid.error) ** 2) if grid.error else 0.0

    def _followed(self, allowed: float, soft: Array) -> tuple[Array, Array, float]:
        """The narrowest band, low and high, and the light that it leaves out.

        Rays don't know that light spreads over a Fresnel zone, so a zone is added; but not
        beyond the band of light from anywhere, for which that makes no difference.
        """
        low, high = self.band(allowed, soft)
        light, frequency, _ = self._seen
        out = float(light[~between(frequency, low, high)].sum())
        least, most = self.band(allowed, soft, anywhere=True)
        wide = low - self.edge.zone, high + self.edge.zone
        low = np.maximum(wide[0], np.minimum(low, least))
        high = np.minimum(wide[1], np.maximum(high, most))
        if (low > wide[0]).any() or (high < wide[1]).any():
            rays = self.edge.scattered
            out = float(rays.anywhere[~between(rays.frequency, low, high)].sum())
        return low, high, out

    def band(self, error: float, soft: Array, *, anywhere: bool = False) -> tuple[Array, Array]:
        """The smallest (low, high), each (y, x), that leaves out no more than an error.

        anywhere: of light from anywhere, on the panel or beside it.
        """
        ordered = self._outward_anywhere if anywhere else self._outward
        lost = self.edge.allowed(error)
        least_low, least_high = self.edge.passing
        best: tuple[Array, Array] | None = None
        for split in _SPLITS:
            parts = (split, split, 1 - split, 1 - split)
            sides = [
                _beyond(*one, lost * share / 2) for one, share in zip(ordered, parts, strict=True)
            ]
            low = np.minimum([-sides[0], -sides[2]], least_low - soft)
            high = np.maximum([sides[1], sides[3]], least_high + soft)
            if best is None or np.prod(high - low) < np.prod(best[1] - best[0]):
                best = low, high
        assert best is not None
        return best


def _four_ways(
    frequency: Array, light: Array, ends: tuple[Array, Array], zone: float
) -> list[tuple[Array, Array]]:
    """Light beyond the ends (low, high) of a band, to each side along each axis."""
    low, high = ends
    found = []
    for axis in (0, 1):
        for sign, end in ((-1, -low[axis]), (1, high[axis])):
            found.append(_outwards(sign * frequency[:, axis], light, float(end), zone))
    return found


def _outwards(frequency: Array, light: Array, end: float, zone: float) -> tuple[Array, Array]:
    """Frequencies beyond an end, the farthest first, and the light from there on outwards.

    In steps of half a percent of a frequency's distance from the end, and of a zone: sorting
    the light itself takes five times as long.
    """
    away = np.log1p(np.maximum(frequency - end, 0.0) / zone)
    steps = math.ceil(float(away.max(initial=0.0)) / _STEP)
    number = np.minimum((away / _STEP).astype(np.int64), steps)
    outwards = np.cumsum(np.bincount(number, light, steps + 1)[::-1])
    reached = end + zone * np.expm1(_STEP * np.arange(steps + 1, 0, -1))
    return reached, outwards.astype(np.float64)


def _beyond(frequency: Array, light: Array, lost: float) -> float:
    """Beyond which frequency no more light than that is scattered."""
    place = int(np.searchsorted(light, lost))
    return float(frequency[place]) if place < frequency.size else -math.inf


def _turned_back(edge: EdgeLight, low: Array, high: Array, rate: Array, passed: Array) -> float:
    """Light that gets into the window's middle by the grid's own frequencies."""
    ways = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1))
    return sum(edge.turned_back(np.array(way) * rate, low, high, passed) for way in ways)
