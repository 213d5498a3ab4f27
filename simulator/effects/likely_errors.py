"""Likely errors of a picture from estimates of how much an effect changes its light."""

from __future__ import annotations

import math
from typing import ClassVar

import torch

from optics.plane import centred_crop
from simulator.effects.electron_bounds import sensor_error_bound
from simulator.effects.picture_norms import estimated_light
from simulator.effects.result_cache import cached_across_patterns
from simulator.planning import Bound, Effect
from simulator.situation import Situation

NEAR, FAR = 2.0, 6.0
"""Relative change of the noise over that of the mean picture, at most but for few, from audits:
for a change near the light's image, and for one that spreads to dim pixels far from it."""


class LightEffect(Effect):
    """An effect that changes the light on the sensor's pixels.

    likely_shares: share of the bound that the error reached at most in audits, for each level; the
    last one stands for all finer levels. noise_change: relative change of the noise over that of
    the mean picture, from audits.
    """

    likely_shares: ClassVar[tuple[float, ...]] = (1.0,)
    noise_change: ClassVar[float] = NEAR

    def likely_error(self, s: Situation, level: int) -> Bound:
        bound = self.error_bound(s, level)
        share = self.likely_shares[min(level, len(self.likely_shares) - 1)]
        how = f"estimated: {share:g} of {bound.how}"
        return self.likely_light_error(s, share * bound.mean, how)

    def likely_light_error(self, s: Situation, change: float, how: str) -> Bound:
        """Estimate the error of the frame when the effect changes the light by an L2 norm.

        change: electrons. √m changes by half the change of m over √m. Two estimates of the norm of
        that are compared: from audits, and for a change that is spread evenly over the frame.
        """
        bound = sensor_error_bound(s, change, how)
        total, norm = (s.exposure * one for one in estimated_light(s))
        if not norm:
            return bound
        by_share = self.noise_change * bound.mean / norm * math.sqrt(total)
        evenly = bound.mean / 2 * math.sqrt(_mean_inverse_variance(s))
        return Bound(bound.mean, bound.variance, min(bound.sigma, by_share, evenly), how=how)


def _mean_inverse_variance(s: Situation) -> float:
    """Return the mean over the frame of 1 / variance, for effects' likely errors, 1/electrons².

    It is the sharp picture's, and so the same for all patterns.
    """
    sensor = s.camera.sensor

    def mean() -> float:
        light = centred_crop(s.picture_probe.sharp_picture, sensor.shape).clamp(min=0) * s.exposure
        noise = sensor.read_noise**2 + sensor.dark_current * s.exposure
        return float((1 / (light + max(noise, 0.1))).mean(dtype=torch.float64))

    return cached_across_patterns(s, ("mean inverse variance", sensor, s.exposure), mean)
