"""Bounds of a picture's change from the change of its PSFs, and the base of whatever blurs.

A picture's light f is convolved with PSFs h. For any blur, ‖Δh ∗ f‖₂ is at most ‖Δh‖₁ ‖f‖₂, and at
most ‖Δh‖₂ ‖f‖₁ (Young); by frequency, it is at most the norm of |ΔH| |F| (Parseval). Where layers
hide each other, both the light and the cover are blurred, so that a change counts twice.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

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
from simulator.effects.likely_errors import LightEffect
from simulator.effects.psf_bounds import has_occlusion
from simulator.effects.rendering_work import added_operations
from simulator.effects.vignetting_bounds import blur_sensitivity
from simulator.planning import Bound, OnOffEffect
from simulator.probing.sampled_frequencies import Gain
from simulator.situation import Situation

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
    """Bound the frame's error where PSFs change by a share of their own light.

    That may be more than the light of ideal pixels.
    share, density: as in psf_error_bound().
    """
    share = min(share, 2.0)
    on_pixel = min(density * s.camera.sensor.pitch**2, 1.0)
    of_points = math.sqrt(on_pixel * share) * total_electrons(s)
    most = min(share * sharp_norm_bound(s), of_points, 2 * light_norm_bound(s))
    return sensor_error_bound(s, occlusion_factor(s) * blur_sensitivity(s) * most, how)


def transfer_error_bound(s: Situation, gain: Gain, how: str) -> Bound:
    """Bound the frame's error where transfer functions change by a gain.

    gain: largest difference of the transfer functions at cycles per metre.
    """
    return proportional_error_bound(
        s,
        occlusion_factor(s)
        * float(s.picture_probe.power_spectrum.filtered_norm_bound(gain))
        * max_light_seconds(s),
        how,
    )


class BlurEffect(LightEffect):
    """An effect that changes PSFs.

    typical_bound_share: typical error over its bound.
    """

    typical_bound_share: ClassVar[float] = 0.3

    def is_present(self, s: Situation) -> bool:
        return not s.picture_probe.is_dark

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
