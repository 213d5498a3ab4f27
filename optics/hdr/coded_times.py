"""Check the exposure times of 8-bit pictures by their frames, without knowing the response curve.

Cameras tell times that are rounded, and they differ from those of a ladder.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BSpline

from optics.hdr.response_curve import HIGHEST
from optics.measuring import RigidMotion

_STEPS_PER_STOP = 3

_FAST = (
    8000, 6400, 5000, 4000, 3200, 2500, 2000, 1600, 1250, 1000, 800, 640, 500, 400, 320, 250, 200,
    160, 125, 100, 80, 60, 50, 40, 30, 25, 20, 15, 13, 10, 8, 6, 5, 4,
)  # fmt: skip
_SLOW = (
    0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.3, 1.6, 2.0, 2.5, 3.2, 4.0, 5.0, 6.0, 8.0, 10.0, 13.0, 15.0,
    20.0, 25.0, 30.0, 60.0,
)  # fmt: skip

NOMINAL_TIMES = (*(1 / one for one in _FAST), *_SLOW)
"""Customary exposure times of cameras, seconds, the shortest first."""

_SAME = 0.006  # relative: .017 s is 1/60 s to 2 %, and isn't taken for it; .0167 s is; chosen


def is_nominal(time: float) -> bool:
    """Return whether a time in seconds is one of the customary numbers."""
    return any(abs(time / one - 1) < _SAME for one in NOMINAL_TIMES)


def shutter_time(time: float) -> float:
    """Return the time that a camera means by a customary number: 1/64 s by 1/60 s.

    time: seconds; others than customary ones are returned as they are.
    """
    if not is_nominal(time):
        return time
    return float(2.0 ** (round(_STEPS_PER_STOP * math.log2(time)) / _STEPS_PER_STOP))


Array = NDArray[np.float64]

_SIDE = 4  # pixels of a patch: its mean has a fourth of the noise, and few have edges; chosen
_PATCHES = 100_000  # of a frame at most, evenly over it; chosen
_BORDER = 8  # pixels without patches: scans have rims; chosen
# Numbers of a patch: below, they are cut or rounded too coarsely; chosen
_LEAST, _LEAST_MEAN = 2, 12.0
# Deviations within a calm patch: the first that leaves enough; chosen
_CALM = (5.0, 8.0, 12.0, 20.0)
_ENOUGH, _TOO_FEW = 600, 40  # patches; chosen
# Medians along both frames' numbers at most, and patches of each at least; chosen
_STEPS, _IN_STEP = 60, 20
_WIDEST = 30.0  # range of the sum of both numbers within a step: curves are straight in it; chosen
_ROUNDING = 0.06  # deviation of a median that rounding leaves, numbers

# Difference of numbers up to which both may be the darkness or the white of a film, which tells
# no light, where other numbers differ by more than the second one. Chosen.
_ALIKE, _APART = 4.0, 10.0


class _Patches(NamedTuple):
    """Means and deviations of the numbers of small patches of a frame, and which patches count."""

    mean: NDArray[np.float32]
    deviation: NDArray[np.float32]
    counts: NDArray[np.bool_]


def _frame_patches(numbers: NDArray[Any], motion: RigidMotion) -> _Patches:
    """Return the patches of a frame's band, at places of the reference, to the nearest pixel.

    numbers: (rows, columns). motion: of the frame.
    """
    shape = np.array(numbers.shape)[:, None]
    middle, half = (shape - 1) / 2, (_SIDE - 1) / 2
    step = max(_SIDE, round(math.sqrt(numbers.size / _PATCHES)))
    inside = [
        np.arange(_BORDER, max(n - _BORDER - _SIDE, _BORDER + 1), step) for n in numbers.shape
    ]
    corner = np.array([one.ravel() for one in np.meshgrid(*inside, indexing="ij")])
    at = np.rint(motion.places(corner + half - middle) + middle - half).astype(np.intp)
    last = shape - _SIDE
    seen = ((at >= 0) & (at <= last)).all(axis=0)
    row, column = np.clip(at, 0, last)
    places = np.ndindex(_SIDE, _SIDE)
    every = np.stack([numbers[row + down, column + right] for down, right in places])
    every = every.astype(np.float32)
    counts = seen & (every.max(axis=0) <= HIGHEST) & (every.min(axis=0) >= _LEAST)
    mean = every.mean(axis=0)
    return _Patches(mean, every.std(axis=0), counts & (mean >= _LEAST_MEAN))


def _compare_levels(first: _Patches, second: _Patches) -> Array:
    """Return numbers that two frames have at the same places, (3, steps).

    The rows are the numbers of the first and of the second frame, and the standard deviation of
    their difference; there are no columns if too few patches are seen well in both.
    """
    both, deviation = first.counts & second.counts, np.maximum(first.deviation, second.deviation)
    for limit in _CALM:
        used = both & (deviation < limit)
        if used.sum() >= _ENOUGH:
            break
    if used.sum() < _TOO_FEW:
        return np.zeros((3, 0))
    total = (first.mean + second.mean)[used].astype(np.float64)
    away = (second.mean - first.mean)[used].astype(np.float64)
    order = np.argsort(total)
    each = max(_IN_STEP, len(order) // _STEPS)
    found = []
    for start in range(0, len(order) - each + 1, each):
        few = order[start : start + each]
        if np.ptp(total[few]) <= _WIDEST:
            middle, whole = np.median(away[few]), np.median(total[few])
            spread = 1.4826 * np.median(np.abs(away[few] - middle))
            # A median's deviation is 1.25 times a mean's.
            known = np.hypot(1.25 * spread / np.sqrt(each), _ROUNDING)
            found.append(((whole - middle) / 2, (whole + middle) / 2, known))
    pairs = np.array(found).reshape(-1, 3).T
    differ = np.abs(pairs[1] - pairs[0])
    return pairs[:, differ > _ALIKE] if differ.max(initial=0) > _APART else pairs


# Knots of the curve's cubic spline, numbers. A logarithm is added to it, which is the curve of
# any gamma. Chosen: closer where the curve bends.
_KNOTS = np.array([0.0] * 4 + [20, 40, 64, 96, 128, 160, 192, 216, 236] + [255.0] * 4)

# Weight of the square of the curve's relative bend, its second derivative over the first, at each
# of the levels below. Chosen on photographs: a tenth of it, or ten times as much, change a factor
# by .5 %.
_BEND = 2.4

_LEVELS = np.linspace(12, 250, 100)

# Of light's logarithm by a smooth curve: pictures without fault leave .2 to 1.5 %; chosen
_MISFIT = 0.01
_FIRST_POWER = 2.2  # of the curve with which fitting begins: a usual gamma
_PASSES = 4  # fits, each with weights by the curve and the residuals before; chosen
_STRAY = 3.0  # robust deviations at which the weight of a pair of numbers is halved
# Deviation of times' logarithms in the fit of weights: one may be half too long; chosen
_LOOSE = 0.3

# Logarithm of a factor from which on it is named, standard deviations by which it differs from 1,
# and the deviation up to which it is known. Chosen: times that are 10 % wrong are to be named;
# those of sound photographs are found to 1 %, of films to 3 %.
_NOTABLE, _SURE, _KNOWN = 0.06, 5.0, 0.03

# Misfit that another time takes away: share, and in light's logarithm; chosen on photographs
_GAIN, _GAINED = 0.3, 0.015
# Part of the best time's gain within which another frame's may as well be the wrong one
_LIKELY = 0.05
_LEAST_CHANGE = 0.025  # logarithm of a factor of such another frame, at least; chosen


@dataclass(frozen=True, eq=False)
class CodedTimes:
    """Whether the times of 8-bit pictures fit together.

    Attributes
    ----------
    times : (frames,)
        Seconds.
    factors : (frames,)
        Light over that of the frame's time, if only this one is wrong.
    deviations : (frames,)
        Standard deviations of the factors' logarithms; infinite for frames that share too little
        with others.
    suspects : tuple of int
        Indices of frames one of which has another time; one if it is known which.
    """

    times: Array
    factors: Array
    deviations: Array
    suspects: tuple[int, ...] = ()

    @property
    def corrections(self) -> Array:
        """Return the factor of the frame whose time is known to be wrong, and 1 for others."""
        factors = np.ones(len(self.times))
        if len(self.suspects) == 1:
            factors[self.suspects[0]] = self.factors[self.suspects[0]]
        return factors

    def explain(self) -> list[str]:
        """Say in words which time is wrong; nothing if none is."""
        if not self.suspects:
            return []
        if len(self.suspects) == 1:
            (one,) = self.suspects
            time, factor = self.times[one], self.factors[one]
            return [
                f"frame {one + 1} has {factor:.3g} times the light of {time:.3g} s, as of "
                f"{factor * time:.3g} s: it was exposed otherwise, or something changed in all of "
                "the picture"
            ]
        each = ", or ".join(
            f"frame {one + 1} of {self.factors[one] * self.times[one]:.3g} s for "
            f"{self.times[one]:.3g} s"
            for one in self.suspects
        )
        return [
            f"the exposure times don't fit together, whatever the response curve is: {each}. These "
            "frames don't tell which; check the times, or add a frame"
        ]


def check_coded_times(
    frames: Sequence[Sequence[NDArray[Any]] | NDArray[Any]],
    exposures: ArrayLike,
    motions: Sequence[RigidMotion] | None = None,
) -> CodedTimes:
    """Check by the frames whether the times of 8-bit pictures fit together.

    Parameters
    ----------
    frames : sequence of sequence of NDArray
        Bands of each frame, (rows, columns), uint8.
    exposures : array_like
        Seconds, one for each frame.
    motions : sequence of RigidMotion, optional
        How frames moved against one of them; none by default.

    Returns
    -------
    CodedTimes
        Without suspects for fewer than three frames that share numbers, which tell nothing, and if
        the times are but those of cameras, rounded: 1/60 s for 1/64 s.
    """
    times = np.asarray(exposures, dtype=np.float64)
    pairs = _pairs(frames, motions or [RigidMotion()] * len(frames))
    if len(times) < 3 or not pairs.size:
        return CodedTimes(times, np.ones(len(times)), np.full(len(times), math.inf))
    found = _Fit(pairs, np.log(times)).checked()
    meant = np.array([shutter_time(one) for one in times])
    if found.suspects and (meant != times).any():
        as_meant = _Fit(pairs, np.log(meant)).checked()
        if not as_meant.suspects:
            return replace(found, suspects=())
    return found


def _pairs(
    frames: Sequence[Sequence[NDArray[Any]] | NDArray[Any]], motions: Sequence[RigidMotion]
) -> Array:
    """Return pairs of numbers: frames, band, numbers, deviation, (6, pairs)."""
    order = np.argsort([np.mean([band.mean() for band in one]) for one in frames], kind="stable")
    found = [np.zeros((6, 0))]
    for band in range(len(frames[0])):
        moved = zip(frames, motions, strict=True)
        patches = [_frame_patches(np.asarray(one[band]), motion) for one, motion in moved]
        # Of neighbours in brightness, and the next ones.
        for place, step in itertools.product(range(len(frames)), (1, 2)):
            if place + step < len(frames):
                one, other = order[place], order[place + step]
                few = _compare_levels(patches[one], patches[other])
                known = np.array([[one], [other], [band]]) * np.ones((1, few.shape[1]))
                found.append(np.concatenate([known, few]))
    return np.concatenate(found, axis=1)


class _Fit:
    """Curves of all bands, and times, by least squares of pairs of numbers.

    pairs: as of `_pairs`. told: logarithms of the times.
    """

    def __init__(self, pairs: Array, told: Array) -> None:
        one, other, band = pairs[:3].astype(np.intp)
        self._told, self._band, (self._low, self._high, known) = told, band, pairs[3:]
        self._width = len(_basis(np.ones(1))[0])
        curves, count = self._width * (int(band.max()) + 1), pairs.shape[1]
        self._curves = np.arange(curves)
        self._design = np.zeros((count, curves + len(told)))
        steps = _basis(self._high) - _basis(self._low)
        for number in np.unique(band):
            self._design[band == number, self._part(number)] = steps[band == number]
        # The light's logarithm rises by that of the times, and of the factors.
        self._design[np.arange(count), curves + other] = -1
        self._design[np.arange(count), curves + one] = 1
        self._wanted = told[other] - told[one]
        self._weight, self._penalty = self._weights(known)

    def _part(self, band: int) -> slice:
        return slice(band * self._width, (band + 1) * self._width)

    def _weights(self, known: Array) -> tuple[Array, Array]:
        """Return weights of the pairs, and the penalty of the curves' bends.

        They are those of a fit in which every time is free, so that a wrong one makes no strays.
        """
        size, first = self._design.shape[1], len(self._curves)
        found, stray = np.zeros(size), np.ones(len(self._wanted))
        found[0 : first : self._width] = _FIRST_POWER
        free = np.diag(np.where(np.arange(size) < first, 0, 1 / _LOOSE**2))
        for _ in range(_PASSES):
            penalty = self._bends(found)
            slope = self._slopes(found, self._low) / 2 + self._slopes(found, self._high) / 2
            variance = (slope * known) ** 2 + _MISFIT**2
            weight = stray / variance
            weighted = self._design.T * weight
            matrix = weighted @ self._design + (penalty + free)
            found = np.linalg.solve(matrix, weighted @ self._wanted)
            away = np.abs(self._wanted - self._design @ found) / np.sqrt(variance)
            scale = max(1.0, 1.4826 * float(np.median(away)))
            stray = 1 / (1 + (away / (_STRAY * scale)) ** 2)
        return weight, penalty

    def _slopes(self, found: Array, numbers: Array) -> Array:
        """Return the slope of each pair's curve at its number."""
        steps, slope = _basis(numbers + 0.5) - _basis(numbers - 0.5), np.zeros(len(numbers))
        for band in np.unique(self._band):
            at = self._band == band
            slope[at] = steps[at] @ found[self._part(band)]
        return np.maximum(slope, 1e-3)

    def _bends(self, found: Array) -> Array:
        """Return the penalty of the curves' relative bends, by the slopes of a fit."""
        penalty = np.zeros((self._design.shape[1],) * 2)
        step = 2.0
        bend = (_basis(_LEVELS + step) - 2 * _basis(_LEVELS) + _basis(_LEVELS - step)) / step**2
        parts = [self._part(band) for band in range(len(self._curves) // self._width)]
        slope = (_basis(_LEVELS + 0.5) - _basis(_LEVELS - 0.5)) @ np.stack(
            [found[few] for few in parts], axis=1
        )
        for few, one in zip(parts, np.maximum(slope, 2e-3).T, strict=True):
            relative = bend / one[:, None]
            penalty[few, few] = _BEND * relative.T @ relative + 1e-6 * np.eye(self._width)
        return penalty

    def _solve(self, columns: NDArray[np.intp]) -> tuple[float, float, float]:
        """Return the misfit, and the last unknown with its variance, of curves and some factors."""
        design, few = self._design[:, columns], np.ix_(columns, columns)
        matrix = (design.T * self._weight) @ design + self._penalty[few]
        covariance = np.linalg.pinv(matrix, rcond=1e-12, hermitian=True)
        found = covariance @ ((design.T * self._weight) @ self._wanted)
        left = self._wanted - design @ found
        misfit = self._weight @ left**2 + found @ self._penalty[few] @ found
        return float(misfit), float(found[-1]), float(covariance[-1, -1])

    def checked(self) -> CodedTimes:
        """Tell which frames' times are wrong, each tried by itself."""
        count, first = len(self._told), len(self._curves)
        misfit, _, _ = self._solve(self._curves)
        gains, logs = np.zeros((2, count))
        deviations = np.full(count, math.inf)
        for frame in np.flatnonzero(np.abs(self._design[:, first:]).sum(axis=0) > 0):
            columns = np.append(self._curves, first + frame)
            one, logs[frame], variance = self._solve(columns)
            gains[frame], deviations[frame] = misfit - one, math.sqrt(max(variance, 0.0))
        suspects: tuple[int, ...] = ()
        best = int(np.argmax(gains))
        gained = math.sqrt(max(gains[best], 0.0) / self._weight.sum())
        # Frames one of which has a wrong time, by what each alone would explain.
        known = (deviations < _KNOWN) & (np.abs(logs) > _SURE * deviations)
        likely = known & (gains > (1 - _LIKELY) * gains[best]) & (np.abs(logs) > _LEAST_CHANGE)
        if (
            gains[best] > _GAIN * misfit
            and gained > _GAINED
            and known[best]
            and np.abs(logs[likely]).max(initial=0) >= _NOTABLE
        ):
            suspects = tuple(np.flatnonzero(likely).tolist())
        return CodedTimes(np.exp(self._told), np.exp(logs), deviations, suspects)


def _basis(numbers: Array) -> Array:
    """Return the functions of which a response curve is made, (numbers, functions)."""
    spline = BSpline.design_matrix(np.clip(numbers, 0, 254.999), _KNOTS, 3).toarray()
    return np.column_stack([np.log(numbers + 1.0), spline])
