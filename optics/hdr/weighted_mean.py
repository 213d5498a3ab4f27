"""Average the exposures of a bracket, pixel by pixel, leaving out those that contradict others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from optics.hdr.bracket import Bracket, Exposure

Array = NDArray[np.float32]
Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Samples:
    """What some pixels tell, (exposures, pixels), the shortest time first.

    Where the light is at a rate, the mean of an exposure has the variance (rate + floor) / time.

    rates: mean of the frames that aren't clipped, electrons per second. times: total time of these
    frames in seconds; 0 where all are clipped. floors: electrons per second that would make as much
    noise as reading, dark current, quantisation and the dark frames do; (exposures, 1) if each
    exposure has one frame. scratch: two more arrays, to compute in.
    """

    exposures: list[Exposure]
    rates: Array
    times: Array
    floors: Array
    scratch: Array

    @property
    def clip_rate(self) -> np.float32:
        """Electrons per second from which the shortest frame clips."""
        return np.float32(self.exposures[0].clip_level / self.exposures[0].time)

    def part(self, where: Indices) -> Samples:
        """Return some of the pixels, by their indices."""
        rates, times, floors = (
            one.take(where, axis=1) if one.shape[1] == self.rates.shape[1] else one
            for one in (self.rates, self.times, self.floors)
        )
        return Samples(self.exposures, rates, times, floors, _scratch(rates))

    def without(self, out: Mask) -> Samples:
        """Leave out exposures, pixel by pixel."""
        times = np.where(out, np.float32(0), self.times)
        return Samples(self.exposures, self.rates, times, self.floors, self.scratch)


def _scratch(rates: Array) -> Array:
    """Return two arrays as large as the rates, to compute in."""
    return np.empty((2, *rates.shape), dtype=np.float32)


def join_samples(parts: list[Samples]) -> Samples:
    """Join the pixels of several parts."""
    first = parts[0]
    rates, times, floors = (
        np.concatenate([getattr(one, name) for one in parts], axis=1)
        for name in ("rates", "times", "floors")
    )
    floors = first.floors if first.floors.shape[1] == 1 else floors
    return Samples(first.exposures, rates, times, floors, _scratch(rates))


def read_samples(bracket: Bracket, rows: slice, space: Array) -> Samples:
    """Return what all pixels in some rows tell. Frames that are clipped don't count.

    space: (4, exposures, as many pixels or more), which holds them: memory that is used again stays
    in the processor's cache.
    """
    exposures, pixels = bracket.exposures, len(range(*rows.indices(bracket.shape[0])))
    pixels *= bracket.shape[1]
    rates, times = space[:2, :, :pixels]
    single = all(len(exposure.frames) == 1 for exposure in exposures)
    floors = np.empty((len(exposures), 1 if single else pixels), dtype=np.float32)
    for exposure, rate, count, floor in zip(exposures, rates, times, floors, strict=True):
        first, *others = exposure.frames
        np.copyto(count, ~bracket.read_electrons(first, rows, rate, time=exposure.time))
        if others:
            rate *= count
            for index in others:
                light = np.empty_like(rate)
                is_open = ~bracket.read_electrons(index, rows, light, time=exposure.time)
                light *= is_open
                rate += light
                count += is_open
            rate /= np.maximum(count, 1)
        # All frames of an exposure share the noise of one mean dark frame.
        shared = exposure.floor / exposure.darks * (1.0 if single else count)
        floor[:] = (exposure.floor + shared) / exposure.time
        count *= np.float32(exposure.time)
    return Samples(exposures, rates, times, floors, space[2:, :, :pixels])


Method = Literal["plain", "Poisson", "Granados", "full"]

METHODS: tuple[Method, ...] = get_args(Method)
"""Ways to merge, the quickest first."""

# Least rate that predicts a variance, over that which makes as much noise as a frame without
# light has. A rate may be negative by chance: counted as 0, it would make the mean variance too
# large.
_LEAST_LIGHT = -0.75


class WeightedMean(NamedTuple):
    """Mean rate of each pixel over all its frames.

    rate: electrons per second; where all exposures are clipped, that from which the shortest one
    clips. information: one over the variance of the rate; 0 where all are clipped.
    """

    rate: Array
    information: Array


def mean_by_time(samples: Samples, method: Method = "Poisson") -> Array:
    """Return the mean rate with weights that don't follow the noise.

    method: "plain" weighs rates by the square of their time, "Poisson" by their time.
    """
    weight = samples.times if method == "Poisson" else samples.times * _own_times(samples)
    return _quotient(_weighted_sum(weight, samples.rates), weight.sum(0), samples)


def information_by_time(samples: Samples, rate: Array, method: Method) -> Array:
    """Return one over the variance of the mean rate by time; 0 where all is clipped."""
    factor = np.float32(1) if method == "Poisson" else _own_times(samples)
    weight = samples.times * factor
    below = weight.sum(0)
    weight *= factor
    variance = _weighted_sum(weight, _noise(samples, rate))
    below *= below
    return np.divide(below, variance, out=below, where=variance > 0)


def _own_times(samples: Samples) -> Array:
    """Return the exposure times, seconds, (exposures, 1)."""
    return np.array([[exposure.time] for exposure in samples.exposures], dtype=np.float32)


def mean_by_variance(samples: Samples, predicted: Array) -> WeightedMean:
    """Return the mean with weights of one over the variance.

    predicted: rate that predicts the variance.
    """
    weight = _noise(samples, predicted)
    np.divide(samples.times, weight, out=weight)
    information = weight.sum(0)
    rate = _quotient(_weighted_sum(weight, samples.rates), information, samples)
    return WeightedMean(rate, information)


def mean_and_contradiction(samples: Samples, predicted: Array) -> tuple[WeightedMean, Array]:
    """Return the mean by variance, and how much the exposures contradict each other.

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
    """Return the variance of the rates times their time, in the samples' scratch."""
    dark = [exposure.floor / exposure.time for exposure in samples.exposures]
    least = np.array(dark, dtype=np.float32)[:, None] * np.float32(_LEAST_LIGHT)
    light = predicted if predicted.min(initial=0) >= least.max() else np.maximum(predicted, least)
    return np.add(light, samples.floors, out=samples.scratch[0])


def _weighted_sum(weight: Array, value: Array) -> Array:
    return np.einsum("kn,kn->n", weight, value)


def _quotient(above: Array, below: Array, samples: Samples) -> Array:
    """Return the mean rate from weighted sums; where nothing is, the clip rate."""
    rate = np.full_like(above, samples.clip_rate)
    return np.divide(above, below, out=rate, where=below > 0)


# Deviations below the largest within which another exposure may as well be wrong; chosen
_ALIKE = 1.0
_FALSE_ALARMS = 5e-4  # share of still pixels that may be taken for moved; chosen


def outlier_limit(exposures: int) -> float:
    """Return the deviations by which an exposure differs where things moved."""
    return float(-ndtri(_FALSE_ALARMS / 2 / max(exposures - 1, 1)))


def may_contradict(contradiction: Array, exposures: int) -> Mask:
    """Return where an exposure may differ from the others by more than the limit.

    The square of each exposure's difference from the others, over its variance, is what chi squared
    would lose without it, and so no larger than chi squared.
    """
    return np.asarray(contradiction > np.float32(outlier_limit(exposures) ** 2))


def leave_out(samples: Samples, mean: WeightedMean) -> tuple[WeightedMean, Mask]:
    """Leave out exposures that contradict the others, the worst first; return where there were any.

    mean: of all of them.
    """
    moved, limit = np.zeros(mean.rate.shape, dtype=bool), outlier_limit(len(samples.exposures))
    for _ in range(len(samples.exposures) - 1):
        several = (samples.times > 0).sum(0) > 1
        weight = samples.times / (np.maximum(mean.rate, 0) + samples.floors)
        information = np.maximum(weight.sum(0), np.float32(1e-30))
        value = (weight * samples.rates).sum(0) / information
        # The value follows each exposure by its share of the information.
        own = np.maximum(1 - weight / information, np.float32(1e-6))
        # How far each exposure is from the merged value, over what chance would make of it.
        differs = np.abs(samples.rates - value) * np.sqrt(weight / own)
        worst = differs.max(axis=0)
        out = several & (worst > limit)
        if not out.any():
            break
        moved |= out
        # Of those that contradict each other about alike, the longest tells most and is kept.
        alike = differs >= worst - _ALIKE
        first = np.arange(len(differs))[:, None] == alike.argmax(axis=0)
        samples = samples.without(first & out)
        for _ in range(2):
            mean = mean_by_variance(samples, mean.rate)
    return mean, moved
