"""Average the exposures of a bracket, pixel by pixel, with weights of several kinds."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal, NamedTuple, get_args

import numpy as np

from optics.hdr.samples import Array, Samples

Method = Literal["plain", "Poisson", "Granados", "full"]

METHODS: tuple[Method, ...] = get_args(Method)
"""Ways to merge, the quickest first."""

_LEAST_LIGHT = -0.75
"""Least rate that predicts a variance, over that which makes as much noise as a frame without light
has. A rate may be negative by chance: counted as 0, it would make the mean variance too large."""


class WeightedMean(NamedTuple):
    """Mean of a bracket's exposures in each pixel.

    rate: electrons per second; where all exposures are clipped, that from which the shortest one
    clips. information: one over the variance of the rate; 0 where all are clipped.
    """

    rate: Array
    information: Array


def mean_by_time(samples: Samples, method: Method = "Poisson") -> Array:
    """Return the mean rate of a bracket with weights that don't follow the noise.

    method: "plain" weighs rates by the square of their time, "Poisson" by their time.
    """
    above, below, weight = np.zeros((3, *samples.rates[0].shape), dtype=np.float32)
    for exposure, rate, time in zip(samples.exposures, samples.rates, samples.times, strict=True):
        if method == "plain":
            time = time * np.float32(exposure.time)
        below += time
        np.multiply(time, rate, out=weight)
        above += weight
    return _quotient(above, below, samples)


def information_by_time(samples: Samples, rate: Array, method: Method) -> Array:
    """Return one over the variance of a bracket's mean rate by time; 0 where all is clipped."""
    variance, below, weight, part = np.zeros((4, *rate.shape), dtype=np.float32)
    for exposure, (light, floor), time in zip(
        samples.exposures, _noise(samples, rate, part), samples.times, strict=True
    ):
        factor = np.float32(exposure.time if method == "plain" else 1.0)
        np.multiply(time, factor, out=weight)
        below += weight
        np.add(light, floor, out=part)
        weight *= part
        weight *= factor
        variance += weight
    below *= below
    return np.divide(below, variance, out=below, where=variance > 0)


def mean_by_variance(samples: Samples, predicted: Array) -> WeightedMean:
    """Return the mean of a bracket's exposures with weights of one over their variance.

    predicted: rate that predicts the variance.
    """
    above, information, weight, part = np.zeros((4, *predicted.shape), dtype=np.float32)
    for (light, floor), rate, time in zip(
        _noise(samples, predicted, part), samples.rates, samples.times, strict=True
    ):
        np.add(light, floor, out=weight)
        np.divide(time, weight, out=weight)
        information += weight
        weight *= rate
        above += weight
    return WeightedMean(_quotient(above, information, samples), information)


def mean_and_contradiction(samples: Samples, predicted: Array) -> tuple[WeightedMean, Array]:
    """Return the mean by variance, and how much a bracket's exposures contradict each other.

    That is the sum of their squared differences from the mean, over their variances (chi squared).
    Differences from the predicted rate are averaged, so that large rates lose no digits.
    """
    above, information, squares, weight, part = np.zeros((5, *predicted.shape), dtype=np.float32)
    for (light, floor), rate, time in zip(
        _noise(samples, predicted, part), samples.rates, samples.times, strict=True
    ):
        np.add(light, floor, out=weight)
        np.divide(time, weight, out=weight)
        information += weight
        np.subtract(rate, predicted, out=part)
        weight *= part
        above += weight
        weight *= part
        squares += weight
    seen = information > 0
    part[:] = 0
    np.divide(above, information, out=part, where=seen)
    rate = predicted + part
    part *= above
    squares -= part
    if not seen.all():
        rate[~seen] = samples.clip_rate(0)
    return WeightedMean(rate, information), squares


def _noise(
    samples: Samples, predicted: Array, part: Array
) -> Iterator[tuple[Array, Array | np.float32]]:
    """Yield, for each exposure of a bracket, two terms of its variance times its time.

    part: is overwritten.
    """
    lowest = predicted.min(initial=0)
    for exposure, floor in zip(samples.exposures, samples.floors, strict=True):
        least = np.float32(_LEAST_LIGHT * exposure.floor / exposure.time)
        yield np.maximum(predicted, least, out=part) if lowest < least else predicted, floor


def _quotient(above: Array, below: Array, samples: Samples) -> Array:
    """Return the mean rate of a bracket from weighted sums; where nothing is, the clip rate."""
    rate = np.full_like(above, samples.clip_rate(0))
    return np.divide(above, below, out=rate, where=below > 0)
