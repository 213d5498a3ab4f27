"""What effects on the light have in common: bounds of what they change, and likely errors.

A picture's light f is convolved with PSFs h. For any blur, ‖Δh ∗ f‖₂ is at most ‖Δh‖₁ ‖f‖₂, and at
most ‖Δh‖₂ ‖f‖₁ (Young); by frequency, it is at most the norm of |ΔH| |F| (Parseval). Where layers
hide each other, both the light and the cover are blurred, so that a change counts twice.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from typing import ClassVar

import numpy as np
import torch

from optics.plane import centred_crop
from simulator.effects.electron_bounds import (
    light_norm_bound,
    max_light_seconds,
    max_panel_power,
    proportional_error_bound,
    relative_light_change,
    sensor_error_bound,
    sharp_norm_bound,
    total_electrons,
)
from simulator.effects.landed_light import landed_light
from simulator.effects.picture_norms import estimated_light, light_share
from simulator.effects.psf_bounds import has_occlusion
from simulator.effects.rendering_work import added_operations
from simulator.effects.result_cache import cached_across_patterns
from simulator.effects.vignetting_bounds import blur_sensitivity
from simulator.planning import Bound, Effect, OnOffEffect
from simulator.probing.sampled_frequencies import Gain
from simulator.situation import Situation

NEAR, FAR = 2.0, 6.0
"""Relative change of the noise over that of the mean picture, at most but for few, from audits:
for a change near the light's image, and for one that spreads to dim pixels far from it."""

MAX_SINC_LOSS = 1.2173
"""Upper bound of 1 - sinc(x), and of |1 - sinc(x) sinc(y)|, for any x and y."""


def occlusion_factor(s: Situation) -> float:
    """Return the factor on an error bound of blur: 2 if layers hide each other, else 1."""
    return 2.0 if has_occlusion(s) else 1.0


def psf_error_bound(s: Situation, change: float, how: str, density: float = math.inf) -> Bound:
    """Bound the frame's error where PSFs change by a share of their light.

    change: ‖Δh‖₁, over the light of ideal pixels; over that of the PSFs it is at most 2, for each
        loses what the other has instead.
    density: largest difference of the PSFs, in shares per square metre of the sensor: ‖Δh‖₂² is at
        most the density times ‖Δh‖₁ times a pixel's area.
    """
    return light_share_bound(s, change / max_panel_power(s), how, density)


def light_share_bound(s: Situation, share: float, how: str, density: float = math.inf) -> Bound:
    """Bound the error where PSFs change by a share of their light; see psf_error_bound()."""
    share = min(share, 2.0)
    on_pixel = min(density * s.camera.sensor.pitch**2, 1.0)
    of_points = math.sqrt(on_pixel * share) * total_electrons(s)
    most = min(share * sharp_norm_bound(s), of_points, 2 * light_norm_bound(s))
    return sensor_error_bound(s, occlusion_factor(s) * blur_sensitivity(s) * most, how)


def transfer_error_bound(s: Situation, gain: Gain, how: str) -> Bound:
    """Bound the frame's error where transfer functions change by a gain, by cycles per metre."""
    filtered = float(s.picture_probe.power_spectrum.filtered_norm_bound(gain))
    change = occlusion_factor(s) * filtered * max_light_seconds(s)
    return proportional_error_bound(s, change, how)


class LightEffect(Effect):
    """An effect that changes the light on the sensor's pixels.

    likely_shares: share of the bound that the error reached at most in audits, for each level; the
        last one stands for all finer levels.
    noise_change: relative change of the noise over that of the mean picture, from audits.
    """

    likely_shares: ClassVar[tuple[float, ...]] = (1.0,)
    noise_change: ClassVar[float] = NEAR

    def is_present(self, s: Situation) -> bool:
        return self.is_caused(s) and not s.picture_probe.is_dark

    def is_caused(self, s: Situation) -> bool:
        """Return whether the effect occurs if there is light."""
        return True

    def likely_error(self, s: Situation, level: int) -> Bound:
        bound = self.error_bound(s, level)
        share = self.likely_shares[min(level, len(self.likely_shares) - 1)]
        how = f"estimated: {share:g} of {bound.how}"
        return self.likely_light_error(s, share * bound.mean, how, bound.sigma)

    def likely_light_error(
        self, s: Situation, change: float, how: str, largest_sigma: float = math.inf
    ) -> Bound:
        """Estimate the error of the frame when its light changes by an L2 norm, electrons.

        σ changes by half the change of m over σ. The least of two or three estimates of the norm of
        that counts: for a change that is spread evenly over the frame, for one that lies where it
        changes the noise most, and for one near the light's image, from audits.
        largest_sigma: bound on that of σ, electrons.
        """
        bound = sensor_error_bound(s, change, how)
        total, norm = (s.exposure * one for one in estimated_light(s))
        if not norm:
            return bound
        even = bound.mean / 2 * math.sqrt(_mean_inverse_variance(s, s.exposure))
        found = [largest_sigma, bound.sigma, even]
        dimmest = _largest_noise_change(s, bound.mean)
        if dimmest is not None:
            found.append(dimmest)
        if dimmest is None or self.noise_change == NEAR:
            found.append(self.noise_change * bound.mean / norm * math.sqrt(total))
        return Bound(bound.mean, bound.variance, min(found), how=how)


class LightChange(OnOffEffect, LightEffect):
    """An effect that is on or off, and changes the light by a bounded number of electrons.

    typical_share: typical change over its bound. how: how the bound is known.
    """

    typical_share: ClassVar[float] = 1.0
    how: ClassVar[str]

    @abstractmethod
    def change(self, s: Situation) -> float:
        """Bound the change of the light, an L2 norm in electrons."""

    def estimated_error_if_omitted(self, s: Situation) -> float:
        return self.typical_share * relative_light_change(s, self.change(s))

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        return sensor_error_bound(s, self.change(s), self.how)


class BlurEffect(LightEffect):
    """An effect that changes PSFs. typical_bound_share: typical error over its bound."""

    typical_bound_share: ClassVar[float] = 0.3

    def estimated_error(self, s: Situation, level: int) -> float:
        return self.typical_bound_share * relative_light_change(s, self.error_bound(s, level).mean)

    def added_operations(self, s: Situation, levels: Mapping[str, int]) -> float:
        return added_operations(s, levels, self.name)


class OnOffBlurEffect(OnOffEffect, BlurEffect):
    """A change of PSFs that is either on or off."""

    typical_bound_share = 0.5

    def estimated_error_if_omitted(self, s: Situation) -> float:
        most = relative_light_change(s, self.error_bound_if_omitted(s).mean)
        return self.typical_bound_share * most


def _largest_noise_change(s: Situation, change: float) -> float | None:
    """Estimate how much a change of an L2 norm changes the map of σ at most, electrons.

    It does most where the frame is dimmest, but hardly changes a pixel's light by more than all of
    it. So the change is given to the dimmest cells of the frame first. None where the light isn't
    estimated by cells.
    """
    landed, seen = landed_light(s), light_share(s)
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


@cached_across_patterns
def _mean_inverse_variance(s: Situation, exposure: float) -> float:
    """Return the mean of 1 / variance over the frame of the sharp picture, 1/electrons²."""
    sensor = s.camera.sensor
    light = centred_crop(s.picture_probe.sharp_picture, sensor.shape).clamp(min=0) * exposure
    noise = sensor.read_noise**2 + sensor.dark_current * exposure
    return float((1 / (light + max(noise, 0.1))).mean(dtype=torch.float64))
