"""Average the exposures of a bracket, pixel by pixel, with weights of several kinds."""

from __future__ import annotations

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
    weight = samples.times if method == "Poisson" else samples.times * _own_times(samples)
    return _quotient(_weighted_sum(weight, samples.rates), weight.sum(0), samples)


def information_by_time(samples: Samples, rate: Array, method: Method) -> Array:
    """Return one over the variance of a bracket's mean rate by time; 0 where all is clipped."""
    factor = np.float32(1) if method == "Poisson" else _own_times(samples)
    weight = samples.times * factor
    below = weight.sum(0)
    weight *= factor
    variance = _weighted_sum(weight, _noise(samples, rate))
    below *= below
    return np.divide(below, variance, out=below, where=variance > 0)


def _own_times(samples: Samples) -> Array:
    """Return the times of a bracket's exposures, seconds, (exposures, 1)."""
    return np.array([[exposure.time] for exposure in samples.exposures], dtype=np.float32)


def mean_by_variance(samples: Samples, predicted: Array) -> WeightedMean:
    """Return the mean of a bracket's exposures with weights of one over their variance.

    predicted: rate that predicts the variance.
    """
    weight = _noise(samples, predicted)
    np.divide(samples.times, weight, out=weight)
    information = weight.sum(0)
    rate = _quotient(_weighted_sum(weight, samples.rates), information, samples)
    return WeightedMean(rate, information)


def mean_and_contradiction(samples: Samples, predicted: Array) -> tuple[WeightedMean, Array]:
    """Return the mean by variance, and how much a bracket's exposures contradict each other.

    That is the sum of their squared differences from the mean, over their variances (chi squared).
    Differences from the predicted rate are averaged, so that large rates lose no digits.
    """
    weight = _noise(samples, predicted)
    np.divide(samples.times, weight, out=weight)
    information = weight.sum(0)
    away = np.subtract(samples.rates, predicted, out=samples.scratch[1])
    weight *= away
    above, squares = weight.sum(0), _weighted_sum(weight, away)
    seen = information > 0
    rate = np.divide(above, information, out=np.zeros_like(above), where=seen)
    above *= rate
    squares -= above
    rate += predicted
    if not seen.all():
        rate[~seen] = samples.clip_rate
    return WeightedMean(rate, information), squares


def _noise(samples: Samples, predicted: Array) -> Array:
    """Return the variance of a bracket's exposures times their time, in the samples' scratch."""
    dark = [exposure.floor / exposure.time for exposure in samples.exposures]
    least = np.array(dark, dtype=np.float32)[:, None] * np.float32(_LEAST_LIGHT)
    light = predicted if predicted.min(initial=0) >= least.max() else np.maximum(predicted, least)
    return np.add(light, samples.floors, out=samples.scratch[0])


def _weighted_sum(weight: Array, value: Array) -> Array:
    """Return the sum of a bracket's exposures with weights."""
    return np.einsum("kn,kn->n", weight, value)


def _quotient(above: Array, below: Array, samples: Samples) -> Array:
    """Return the mean rate of a bracket from weighted sums; where nothing is, the clip rate."""
    rate = np.full_like(above, samples.clip_rate)
    return np.divide(above, below, out=rate, where=below > 0)
