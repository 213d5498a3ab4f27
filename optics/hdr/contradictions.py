"""Leave exposures out that contradict the others, pixel by pixel: something moved there."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtri

from optics.hdr.samples import Array, Mask, Samples
from optics.hdr.weighted_mean import WeightedMean, mean_by_variance

_ALIKE = 1.0
"""Standard deviations below the largest difference within which another exposure may as well be the
wrong one. Chosen."""

_FALSE_ALARMS = 5e-4
"""Share of still pixels that may be taken for moved. Chosen."""


def outlier_limit(exposures: int) -> float:
    """Return the deviations by which an exposure of a bracket differs where things moved."""
    return float(-ndtri(_FALSE_ALARMS / 2 / max(exposures - 1, 1)))


def may_contradict(contradiction: Array, exposures: int) -> Mask:
    """Return where an exposure of a bracket may differ from the others by more than the limit.

    The square of each exposure's difference from the others, over its variance, is what chi squared
    would lose without it, and so no larger than chi squared.
    """
    return np.asarray(contradiction > np.float32(outlier_limit(exposures) ** 2))


def leave_out(samples: Samples, mean: WeightedMean) -> tuple[WeightedMean, Mask]:
    """Leave contradictory exposures of a bracket out, the worst first; return where there were any.

    mean: of all of them.
    """
    moved, limit = np.zeros(mean.rate.shape, dtype=bool), outlier_limit(len(samples.exposures))
    for _ in range(len(samples.exposures) - 1):
        several = (samples.times > 0).sum(0) > 1
        differs = _differences(samples, mean.rate)
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


def _differences(samples: Samples, rate: Array) -> Array:
    """Return how far each exposure is from the HDR value, over what chance would make of it.

    rate: predicts the variance.
    """
    weight = samples.times / (np.maximum(rate, 0) + samples.floors)
    information = np.maximum(weight.sum(0), np.float32(1e-30))
    value = (weight * samples.rates).sum(0) / information
    # The value follows each exposure by its share of the information.
    own = np.maximum(1 - weight / information, np.float32(1e-6))
    return np.asarray(np.abs(samples.rates - value) * np.sqrt(weight / own))
