"""Mean, noise and defects of a group of pixels: those of an area behind one colour of filter.

Noise of less than a step of the converter is told from its numbers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, least_squares
from scipy.special import ndtr

from optics.measuring.paired_frames import PairedFrames, PairNoise, measure_pair
from optics.measuring.pixel_maps import (
    GroupDefects,
    Mask,
    average_frames,
    find_defects,
    without_slow_changes,
)

Array = NDArray[np.float64]

STEP_VARIANCE = 1 / 12  # steps²: what rounding adds to noise of more than half a step
SURE_VARIANCE = 0.36  # steps²: of a noise for which the twelfth is right to 1 %, 4 exp(-2π² · .36)
_NODES = 2001  # levels between -6 and 6 standard deviations over which pixels are summed
_LEAST = 1e-3  # steps: least noise that is looked for


def rounded_moments(level: Array, noise: float) -> tuple[Array, Array]:
    """Compute mean and variance of noisy levels after rounding, in steps."""
    centre = np.round(level)
    reach = math.ceil(6 * noise) + 1
    mean, square = np.zeros_like(level), np.zeros_like(level)
    for step in range(-reach, reach + 1):
        low, high = (centre + step + side - level for side in (-0.5, 0.5))
        share = ndtr(high / noise) - ndtr(low / noise)
        mean += step * share
        square += step**2 * share
    return centre + mean, square - mean**2


def noise_below_a_step(mean: float, over_pixels: float, temporal: float) -> float:
    """Find the noise before rounding, in steps.

    mean, over_pixels: mean and variance of all numbers of a frame.
    temporal: mean temporal variance of the pixels.

    The larger of two values is given where both explain it.
    """

    def misfit(parameters: Array) -> Array:
        level, width = parameters
        found = rounded_moments(np.array([level]), width)
        return np.array([found[0][0] - mean, found[1][0] - over_pixels])

    start = [mean, math.sqrt(max(over_pixels - STEP_VARIANCE, 0.05))]
    fitted = least_squares(misfit, start, bounds=([mean - 1, _LEAST], [mean + 1, np.inf]))
    level, width = fitted.x

    def excess(noise: float) -> float:
        # Over the normal distribution of the pixels' levels.
        spread = math.sqrt(max(width**2 - noise**2, 0.0))
        if spread < _LEAST:
            return float(rounded_moments(np.array([level]), noise)[1][0]) - temporal
        places = np.linspace(-6, 6, _NODES)
        shares = np.exp(-(places**2) / 2)
        variances = rounded_moments(level + spread * places, noise)[1]
        return float((shares * variances).sum() / shares.sum()) - temporal

    # Never more than the noise and the pixels' spread together.
    if excess(width) <= 0:
        return float(width)
    if excess(_LEAST) >= 0:
        return _LEAST
    return float(brentq(excess, _LEAST, width, xtol=1e-5))


_BRIGHT = 99.9  # percentile of a group's numbers that is its brightest pixel; chosen, below defects
# Of the largest signal, up to which the brightest pixel is clear of clipping; chosen
_OPEN_SHARE = 0.8
_LIT_SHARE = 0.05  # of the largest signal, from which an exposure tells of the response; chosen


@dataclass(frozen=True)
class DarkStatistics:
    """A group of pixels in darkness of one exposure time.

    exposure: seconds.
    mean: number, DN.
    variance: temporal, of a frame, DN².
    over_pixels: variance of all numbers of a frame, DN².
    spread, count: as in PairNoise.
    zeros: share of numbers that are 0.
    pixels: good ones.
    """

    exposure: float
    mean: float
    variance: float
    over_pixels: float
    spread: float
    count: int
    zeros: float
    pixels: int


@dataclass(frozen=True)
class LightStatistics:
    """A group of pixels in light of one exposure time, and in darkness of the same.

    Beside what `DarkStatistics` has, brightest: number of the brightest pixel, DN.
    signal: mean less the mean dark number.
    ratio: light of the later frames over that of the earlier ones.
    """

    exposure: float
    mean: float
    brightest: float
    signal: float
    variance: float
    spread: float
    count: int
    ratio: float
    dark: DarkStatistics


def half_products(first: Array, second: Array) -> Array:
    """Return count, sums, sums of squares and sum of products of a map's halves, (6,)."""
    squares = (first**2).sum(), (second**2).sum()
    return np.array([first.size, first.sum(), second.sum(), *squares, (first * second).sum()])


@dataclass(frozen=True, eq=False)
class GroupStatistics:
    """What is measured on a group of pixels.

    filter: (row, column) of the group's colour filter in its period.
    light, dark: by rising exposure time.
    response, offsets: `half_products` of relative response without slow changes, zeros where that
        isn't known, and of dark numbers.
    rows, columns: of the pixels.
    """

    filter: tuple[int, int]
    light: list[LightStatistics]
    dark: list[DarkStatistics]
    response: Array
    offsets: Array
    defects: GroupDefects
    rows: NDArray[np.int64]
    columns: NDArray[np.int64]


def measure_groups(source: PairedFrames) -> list[GroupStatistics]:
    """Measure all groups of pixels, area by area.

    Raises ValueError for numbers that aren't finite, or if half of a group looks defective.
    """
    found, (down, along) = [], source.period
    for rows, columns in source.areas:
        frames = np.stack([np.asarray(frame[rows, columns]) for frame in source.frames])
        if not np.isfinite(frames).all():
            raise ValueError("a frame has NaN or infinite numbers; leave it out")
        for y, x in np.ndindex(down, along):
            own = frames[:, y::down, x::along]
            if own.size:
                places = np.mgrid[
                    rows.start + y : rows.stop : down, columns.start + x : columns.stop : along
                ]
                found.append(_measure_group(source, own, (y, x), places))
    return found


def _measure_group(
    source: PairedFrames,
    frames: NDArray[Any],
    place: tuple[int, int],
    places: NDArray[np.int64],
) -> GroupStatistics:
    """Measure one group on all of its frames, (frames, rows, columns)."""
    maps = average_frames(frames, source.light, source.dark, _bright_exposures(source, frames))
    defects = find_defects(maps, max(source.dark))
    good = defects.good
    if good.sum() < max(16, 0.5 * good.size):
        raise ValueError(
            f"{(~good).sum()} of {good.size} pixels around row {places[0].mean():.0f}, column "
            f"{places[1].mean():.0f} look defective; check that light and darkness are what they "
            "are said to be, and that the light is even"
        )
    dark = [_dark_statistics(source, frames, time, good) for time in source.dark]
    levels = {one.exposure: one for one in dark}
    light = [_light_statistics(source, frames, levels[time], good) for time in source.light]
    response = np.zeros(6)
    if maps.response is not None:
        response = half_products(*(without_slow_changes(one, good)[good] for one in maps.response))
    offsets = half_products(maps.dark[0][good], maps.dark[1][good])
    return GroupStatistics(place, light, dark, response, offsets, defects, *places)


def _bright_exposures(source: PairedFrames, frames: NDArray[Any]) -> list[float]:
    """Return exposure times at which a group is bright, and clear of clipping."""
    darkness = {time: float(frames[source.dark[time][0][0]].mean()) for time in source.light}
    first = {time: frames[pairs[0][0]] for time, pairs in source.light.items()}
    room = max(float(frame.mean()) - darkness[time] for time, frame in first.items())
    return [
        time
        for time, frame in first.items()
        if frame.mean() - darkness[time] > _LIT_SHARE * room
        and np.percentile(frame, _BRIGHT) - darkness[time] < _OPEN_SHARE * room
    ]


def _dark_statistics(
    source: PairedFrames, frames: NDArray[Any], time: float, good: Mask
) -> DarkStatistics:
    """Measure the dark pairs of an exposure time on a group's good pixels."""
    pairs = [measure_pair(frames[a], frames[b], good) for a, b in source.dark[time]]
    every = [frames[index][good] for pair in source.dark[time] for index in pair]
    mean, variance, spread, count = _combine(pairs)
    over_pixels = float(np.mean([one.var(dtype=np.float64) for one in every]))
    zeros = float(np.mean([(one <= 0).mean() for one in every]))
    return DarkStatistics(time, mean, variance, over_pixels, spread, count, zeros, int(good.sum()))


def _light_statistics(
    source: PairedFrames, frames: NDArray[Any], dark: DarkStatistics, good: Mask
) -> LightStatistics:
    """Measure the pairs in light of an exposure time on a group's good pixels."""
    listed = source.light[dark.exposure]
    pairs = [measure_pair(frames[a], frames[b], good, dark.mean) for a, b in listed]
    mean, variance, spread, count = _combine(pairs)
    brightest = float(np.percentile(frames[listed[0][0]][good], _BRIGHT))
    ratio = max((one.ratio for one in pairs), key=lambda ratio: abs(ratio - 1))
    return LightStatistics(
        dark.exposure, mean, brightest, mean - dark.mean, variance, spread, count, ratio, dark
    )


def _combine(pairs: list[PairNoise]) -> tuple[float, float, float, int]:
    """Return mean, variance, spread and count of several pairs."""
    counts = [one.count for one in pairs]
    return (
        float(np.mean([one.mean for one in pairs])),
        float(np.average([one.variance for one in pairs], weights=counts)),
        float(np.mean([one.spread for one in pairs])),
        sum(counts),
    )
