"""Likely errors of a picture from estimates of how much its light changes."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np
import torch

from optics.plane import centred_crop
from simulator.effects.electron_bounds import sensor_error_bound
from simulator.effects.landed_light import landed_light
from simulator.effects.picture_norms import estimated_light, estimated_light_share
from simulator.effects.result_cache import cached_across_patterns
from simulator.planning import Bound, Effect
from simulator.situation import Situation

NEAR, FAR = 2.0, 6.0
"""Relative change of the noise over that of the mean picture, at most but for few, from audits:
for a change near the light's image, and for one that spreads to dim pixels far from it."""


class LightEffect(Effect):
    """An effect that changes the light on the sensor's pixels.

    likely_shares: share of the bound that the error reached at most in audits, for each level; the
        last one stands for all finer levels.
    noise_change: relative change of the noise over that of the mean picture, from audits.
    """

    likely_shares: ClassVar[tuple[float, ...]] = (1.0,)
    noise_change: ClassVar[float] = NEAR

    def likely_error(self, s: Situation, level: int) -> Bound:
        bound = self.error_bound(s, level)
        share = self.likely_shares[min(level, len(self.likely_shares) - 1)]
        how = f"estimated: {share:g} of {bound.how}"
        return self.likely_light_error(s, share * bound.mean, how, bound.sigma)

    def likely_light_error(
        self, s: Situation, change: float, how: str, largest_sigma: float = math.inf
    ) -> Bound:
        """Estimate the error of the frame when its light changes by an L2 norm.

        σ changes by half the change of m over σ. The least of two or three estimates of the norm of
        that counts: for a change that is spread evenly over the frame, for one that lies where it
        changes the noise most, and for one near the light's image, from audits.
        change: electrons.
        largest_sigma: bound on that of σ, electrons.
        """
        bound = sensor_error_bound(s, change, how)
        total, norm = (s.exposure * one for one in estimated_light(s))
        if not norm:
            return bound
        found = [largest_sigma, bound.sigma, bound.mean / 2 * math.sqrt(_mean_inverse_variance(s))]
        dimmest = _largest_noise_change(s, bound.mean)
        if dimmest is not None:
            found.append(dimmest)
        if dimmest is None or self.noise_change == NEAR:
            found.append(self.noise_change * bound.mean / norm * math.sqrt(total))
        return Bound(bound.mean, bound.variance, min(found), how=how)


def _largest_noise_change(s: Situation, change: float) -> float | None:
    """Estimate how much a change of an L2 norm changes the map of σ at most, electrons.

    It does most where the frame is dimmest, but hardly changes a pixel's light by more than all of
    it. So the change is given to the dimmest cells of the frame first. None where the light isn't
    estimated by cells.
    """
    landed, seen = landed_light(s), estimated_light_share(s)
    if landed is None:
        return None
    light = np.sort(landed.cells, axis=None) * (s.exposure * seen)
    noise = s.camera.sensor.read_noise**2 + s.camera.sensor.dark_current * s.exposure
    squares = (light * landed.pixels) ** 2
    # √(2 m + r²) - √(m + r²), and the square of it over that of m where nothing is left to m.
    moved = light / (np.sqrt(2 * light + noise) + np.sqrt(light + noise)).clip(1e-30)
    before = np.concatenate([[0.0], np.cumsum(squares)])
    given = np.clip(change**2 - before[:-1], 0.0, squares)
    shares = given / squares.clip(1e-300)
    return float(math.sqrt((shares * (moved * landed.pixels) ** 2).sum()))


def _mean_inverse_variance(s: Situation) -> float:
    """Return the mean over the frame of 1 / variance, 1/electrons².

    It is the sharp picture's, and so the same for all patterns.
    """
    sensor = s.camera.sensor

    def mean() -> float:
        light = centred_crop(s.picture_probe.sharp_picture, sensor.shape).clamp(min=0) * s.exposure
        noise = sensor.read_noise**2 + sensor.dark_current * s.exposure
        return float((1 / (light + max(noise, 0.1))).mean(dtype=torch.float64))

    return cached_across_patterns(s, ("mean inverse variance", sensor, s.exposure), mean)
