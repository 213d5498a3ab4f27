"""From a change of how points spread to a change of the picture.

A picture's light f is blurred by PSFs h. Whatever the blur, ‖Δh ∗ f‖₂ is at most ‖Δh‖₁ ‖f‖₂, and
at most ‖Δh‖₂ ‖f‖₁ (Young), and by frequency at most that of |ΔH| |F| (Parseval). Where layers hide
each other, what shines and what hides it are both blurred: the change counts twice.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

from simulator.effects.electron_bounds import (
    light_norm_bound,
    max_lamp_seconds,
    proportional_error_bound,
    sensor_error_bound,
    sharp_norm_bound,
    total_electrons,
)
from simulator.effects.psf_bounds import blur_sensitivity, has_occlusion
from simulator.effects.rendering_work import added_operations
from simulator.planning import Bound, Effect, OnOffEffect
from simulator.probing.radial import Gain
from simulator.situation import Situation


def occlusion_factor(s: Situation) -> float:
    """How often a change counts."""
    return 2.0 if has_occlusion(s) else 1.0


def psf_error_bound(s: Situation, change: float, how: str, density: float = math.inf) -> Bound:
    """Of PSFs that differ by a share of their light, ‖Δh‖₁, 2 at most; both lose what the other
    hasn't.

    density: shares a square metre of sensor by which they differ anywhere, at most: ‖Δh‖₂² is no
    more than that times ‖Δh‖₁ times a pixel.
    """
    change = min(change, 2.0)
    on_pixel = min(density * s.camera.sensor.pitch**2, 1.0)
    of_points = math.sqrt(on_pixel * change) * total_electrons(s)
    most = min(change * sharp_norm_bound(s), of_points, 2 * light_norm_bound(s))
    return sensor_error_bound(s, occlusion_factor(s) * blur_sensitivity(s) * most, how)


def transfer_error_bound(s: Situation, gain: Gain, how: str) -> Bound:
    """Of transfer functions that differ by a gain at most, of cycles per metre."""
    return proportional_error_bound(
        s,
        occlusion_factor(s)
        * float(s.picture_probe.power_spectrum.filtered_norm_bound(gain))
        * max_lamp_seconds(s),
        how,
    )


def relative_light_error(s: Situation, bound: Bound) -> float:
    """About the relative change that a bound leaves of the sharp picture."""
    whole_light = light_norm_bound(s)
    return bound.mean / whole_light if whole_light else 0.0


class BlurEffect(Effect):
    """An effect that changes how points spread.

    typical_bound_share: about how much of its bound is true.
    """

    typical_bound_share: ClassVar[float] = 0.3

    def is_present(self, s: Situation) -> bool:
        return not s.picture_probe.is_dark

    def estimated_error(self, s: Situation, level: int) -> float:
        return self.typical_bound_share * relative_light_error(s, self.error_bound(s, level))

    def work(self, s: Situation, levels: Mapping[str, int]) -> float:
        return added_operations(s, levels, self.name)


class OnOffBlurEffect(OnOffEffect, BlurEffect):
    """One of these that is on or off."""

    typical_bound_share = 0.5

    def estimated_error_if_omitted(self, s: Situation) -> float:
        return self.typical_bound_share * relative_light_error(s, self.error_bound_if_omitted(s))
