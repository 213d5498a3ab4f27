"""Recover the response curve of 8-bit pictures from their exposure bracket.

The number of a pixel is an unknown rising function of the logarithm of its light times the exposure
time. The curve that fits all pixels of all frames best, and is smooth, is found by least squares,
with the light of every pixel eliminated: Debevec and Malik, SIGGRAPH 1997, doi
10.1145/258734.258884.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.optimize
import scipy.sparse
from numpy.typing import ArrayLike, NDArray

from optics.validation import require_unmasked

Array = NDArray[np.float64]
Numbers = NDArray[np.uint8]

LOWEST, HIGHEST = 5, 250
"""Numbers of an 8-bit picture that count: others may be clipped. Chosen."""

_LEVELS = 256

_PIXELS = 60_000  # that tell the curve, evenly over the frames; chosen

# Weight of the curve's squared second differences, in units of the number of pixels, for exposures
# that differ by factors of two, and the power of the factor's logarithm by which it grows: frames
# tell nothing of ripples that repeat with their factor; chosen on photographs of factors of 2 and 8
_SMOOTHNESS, _SMOOTHER = 1.0, 7.0

_FIRST_NOISE = (1.0, 0.1)  # deviations at first: of a number, and of light, relative; chosen
_PASSES = 3  # fits, each with weights by the slope of the curve before; chosen
_LEAST_RISE = 1e-3  # of the curve from a number to the next: a small part of the mean one; chosen
_BEYOND = 10.0  # rise for each number beyond the ends of what light makes; chosen
_BINS = 20  # ranges of slope in which the scatter of numbers is measured; chosen
_MOVED = 8.0  # robust deviations of a misfit beyond which something moved in a pixel; chosen
_LEAST_SPAN = 20  # range of numbers from which on a curve can be told; chosen
_NEARLY_ALL = 0.9  # share of numbers that are clipped, or dark, from which on it's said; chosen
_LEAST_PIXELS = 1000  # with good numbers in two frames, from which on a curve can be told; chosen


@dataclass(frozen=True, eq=False)
class ResponseCurve:
    """Logarithm of the exposure that makes each number of an 8-bit picture, (256,), rising.

    Its scale is arbitrary: number 128 has the exposure 1. number_noise: standard deviation of
    numbers. light_noise: relative standard deviation of light, by what differs between frames.
    """

    logs: Array
    number_noise: float
    light_noise: float

    @cached_property
    def ends(self) -> tuple[int, int]:
        """Return the lowest and highest number that tell light.

        Between them, the numbers' noise is less than a factor of e in light.
        """
        clear = np.flatnonzero(np.gradient(self.logs) * self.number_noise < 1)
        clear = clear[clear <= HIGHEST]
        return int(clear[0]), int(clear[-1])

    def number(self, logs: Array) -> tuple[Array, Array]:
        """Return the number that an exposure makes, and its change with the exposure's logarithm.

        logs: logarithms of exposures.
        """
        slope, rise = self._slopes
        number = np.interp(logs, self.logs, np.arange(_LEVELS, dtype=np.float64))
        # Linear between the same two levels: the search for them is the dear part.
        below = np.minimum(number.astype(np.intp), _LEVELS - 2)
        return number, slope[below] + (number - below) * rise[below]

    @cached_property
    def _slopes(self) -> tuple[Array, Array]:
        """Return the slope of numbers over the exposure's logarithm, and its step to the next."""
        slope = np.gradient(np.arange(_LEVELS), self.logs)
        return slope, np.diff(slope)

    def weights(self, numbers: NDArray[np.intp], used: NDArray[np.bool_]) -> Array:
        """Return one over the variance of light's logarithm, as numbers tell it, where used."""
        noise = (self.number_noise * np.gradient(self.logs)) ** 2 + self.light_noise**2
        return (1 / noise)[numbers] * used


def fit_response(
    frames: Sequence[NDArray[Any]] | NDArray[Any], exposures: ArrayLike
) -> ResponseCurve:
    """Recover the response curve of a camera from 8-bit pictures of several exposure times.

    Parameters
    ----------
    frames : sequence of NDArray
        Each (rows, columns), uint8; or float32, numbers between those of 8-bit pixels.
    exposures : array_like
        Seconds, one for each frame.

    Returns
    -------
    ResponseCurve

    Raises
    ------
    ValueError
        For fewer than two exposure times, if too few pixels have numbers between 5 and 250 in two
        frames, and if numbers hardly change.
    """
    times = np.log(np.asarray(exposures, dtype=np.float64))
    if len(np.unique(times)) < 2:
        raise ValueError("a response curve takes frames of two exposure times at least")
    require_unmasked(frames)
    every = max(1, math.prod(np.shape(frames[0])[:2]) // _PIXELS)
    numbers = np.array([np.rint(np.asarray(one).ravel()[::every]) for one in frames])
    numbers = numbers.astype(np.intp)
    used = (numbers >= LOWEST) & (numbers <= HIGHEST)
    enough = used.sum(axis=0) >= 2
    if enough.sum() < min(_LEAST_PIXELS, numbers.shape[1] // 2):
        missing = "exposures between them"
        if (numbers > HIGHEST).mean() > _NEARLY_ALL:
            missing = "shorter exposures"
        elif (numbers < LOWEST).mean() > _NEARLY_ALL:
            missing = "longer exposures"
        raise ValueError(
            f"{int(enough.sum())} pixels have numbers from {LOWEST} to {HIGHEST} in two frames, "
            f"which is too few for a response curve; add {missing}"
        )
    numbers, used = numbers[:, enough], used[:, enough]
    if np.ptp(np.where(used, numbers, numbers[used][0])) < _LEAST_SPAN:
        raise ValueError(
            "numbers hardly change with the exposure time, or from pixel to pixel: they tell no "
            "response curve; check that these are frames of a bracket"
        )
    curve = ResponseCurve(np.linspace(-2.0, 2.0, _LEVELS), *_FIRST_NOISE)
    for _ in range(_PASSES):
        curve = _fit(numbers, used, times, curve)
        still = ~_contradicts(numbers, used, times, curve)
        numbers, used = numbers[:, still], used[:, still]
    return _with_noise(numbers, used, times, curve)


def _fit(
    numbers: NDArray[np.intp], used: NDArray[np.bool_], times: Array, before: ResponseCurve
) -> ResponseCurve:
    """Fit the curve, with weights by the slope of the one before."""
    weight = before.weights(numbers, used)
    count, pixels = numbers.shape
    whole = weight.sum(axis=0)
    places = np.tile(np.arange(pixels), count)
    # Each pixel's light is the weighted mean of what its numbers say.
    design = scipy.sparse.csr_matrix(
        (weight.ravel(), (places, numbers.ravel())), shape=(pixels, _LEVELS)
    )
    known = weight * times[:, None]
    matrix = np.diag(np.bincount(numbers.ravel(), weight.ravel(), _LEVELS))
    matrix -= (design.T @ scipy.sparse.diags(1 / whole) @ design).toarray()
    wanted = np.bincount(numbers.ravel(), known.ravel(), _LEVELS)
    wanted = wanted - design.T @ (known.sum(axis=0) / whole)
    bend = np.diff(np.eye(_LEVELS), 2, axis=0)
    widest = (np.diff(np.unique(times)) / math.log(2)).max()
    smoothness = float(_SMOOTHNESS * max(1.0, widest) ** _SMOOTHER)
    matrix += smoothness * pixels * bend.T @ bend
    # The scale of all light can't be told.
    middle = _LEVELS // 2
    matrix[middle, middle] += whole.sum()
    logs = _rising(np.linalg.solve(matrix, wanted), middle)
    return ResponseCurve(logs - logs[middle], before.number_noise, before.light_noise)


def _contradicts(
    numbers: NDArray[np.intp], used: NDArray[np.bool_], times: Array, curve: ResponseCurve
) -> NDArray[np.bool_]:
    """Return pixels, (pixels,), in which frames contradict the curve: something moved."""
    weight = curve.weights(numbers, used)
    whole = np.maximum(weight.sum(axis=0), 1e-12)
    said = curve.logs[numbers] - times[:, None]
    left = np.where(used, said - (weight * said).sum(axis=0) / whole, 0)
    misfit = (weight * left**2).sum(axis=0)
    counted = misfit[used.sum(axis=0) > 1]
    return misfit > _MOVED**2 * (np.median(counted) if counted.size else np.inf)


def _rising(logs: Array, middle: int) -> Array:
    """Return a rising curve near another one, whose ends may bend back.

    Numbers beyond the ends are no light's: there, light changes much for each number. The lower end
    is where the curve is steepest. Numbers below are those of no light, with its noise, and their
    mean light says nothing.
    """
    lowest = LOWEST + int(np.argmax(np.diff(logs[LOWEST:middle])))
    highest = middle + int(np.argmax(logs[middle:]))
    inside = scipy.optimize.isotonic_regression(logs[lowest : highest + 1]).x
    rises = np.maximum(np.diff(inside), _LEAST_RISE)
    inside = inside[0] + np.concatenate([[0.0], np.cumsum(rises)])
    below = inside[0] - _BEYOND * np.arange(lowest, 0, -1)
    above = inside[-1] + _BEYOND * np.arange(1, len(logs) - highest)
    return np.concatenate([below, inside, above])


def _with_noise(
    numbers: NDArray[np.intp], used: NDArray[np.bool_], times: Array, curve: ResponseCurve
) -> ResponseCurve:
    """Return the curve with the noise by which pairs of frames contradict it.

    Where the curve is flat, the numbers' own noise decides; where it's steep, that of the light.
    """
    logs, flat = curve.logs[numbers] - times[:, None], np.gradient(curve.logs)[numbers] ** 2
    # Numbers beyond the curve's ends are noise alone.
    used = used & (flat < 1)
    pairs = []
    for one, other in itertools.pairwise(np.argsort(times)):
        both = used[one] & used[other]
        pairs.append(((logs[one] - logs[other])[both], (flat[one] + flat[other])[both]))
    every, flatness = (np.concatenate(one) for one in zip(*pairs, strict=True))
    if not flatness.size:
        raise ValueError(
            "no pixel has numbers that light makes in two neighbouring exposures, which tells no "
            "response curve; add exposures between them"
        )
    edges = np.quantile(flatness, np.linspace(0, 1, _BINS + 1)[1:-1])
    group = np.searchsorted(edges, flatness, side="right")
    square, mean = [], []
    for one in np.unique(group):
        size = np.abs(every[group == one])
        # What moved doesn't count.
        still = size <= max(_MOVED * (1.4826 * float(np.median(size))), float(size.min()))
        square.append(float(np.mean(size[still] ** 2)))
        mean.append(np.median(flatness[group == one]))
    # The square is that of the number's noise times the flatness, and twice that of the light.
    relative = 1 / np.maximum(square, 1e-9)
    design = np.stack([np.array(mean) * relative, 2 * relative], axis=1)
    (own, light), _ = scipy.optimize.nnls(design, np.array(square) * relative)
    return ResponseCurve(curve.logs, max(own, 1 / 12) ** 0.5, max(light, 1e-6) ** 0.5)
