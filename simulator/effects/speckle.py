"""Speckle: a rough object's light interferes with itself."""

from __future__ import annotations

import math
from dataclasses import replace

from simulator.effects.electron_bounds import (
    PixelwiseEffect,
    can_clip,
    can_clip_at_zero,
    light_norm_bound,
    peak_electrons,
    pixel_count,
    relative_light_change,
    sensor_error_bound,
)
from simulator.planning import Bound
from simulator.situation import Situation
from simulator.speckle import speckle_variance


class Speckle(PixelwiseEffect):
    """Light of a rough object, which varies between pixels by its contrast, whatever its mean."""

    name = "speckle"
    recipe_field = "speckle"
    operations_per_pixel = 20.0
    physics = "light that a rough object scatters in random phase interferes with itself"
    source = "Goodman 2020, Speckle Phenomena in Optics, chapters 4 to 6"

    def is_present(self, s: Situation) -> bool:
        return s.target.speckle is not None and not s.picture_probe.is_dark

    def estimated_error_if_omitted(self, s: Situation) -> float:
        change = math.sqrt(speckle_variance(s)) * light_norm_bound(s)
        return relative_light_change(s, change)

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        """Bound what speckle adds to the variance, v m² for a mean m.

        √(a + v m²) - √a is at most √v m. Where wells or numbers clip, the mean changes by at most
        the mean deviation of the light, √v m.
        """
        variance, norm = speckle_variance(s), light_norm_bound(s)
        width = math.sqrt(variance) * norm
        slope = sensor_error_bound(s, 1.0, "").mean
        clips = can_clip(s) or can_clip_at_zero(s.camera.sensor)
        rounding = 0.5 * s.camera.sensor.gain * math.sqrt(pixel_count(s))
        mean = slope * width if clips else min(slope * width, rounding)
        added = variance * peak_electrons(s) * norm
        return Bound(
            mean, slope**2 * added + 2 * mean**2, slope * width, how="proved: the contrast's square"
        )

    def likely_error(self, s: Situation, level: int) -> Bound:
        """Estimate what speckle adds beside shot noise: v m² over twice √m, for a mean m."""
        bound = self.error_bound(s, level)
        beside_shot = speckle_variance(s) * math.sqrt(peak_electrons(s)) * light_norm_bound(s) / 2
        how = "estimated: the contrast's square beside shot noise"
        return replace(bound, sigma=min(bound.sigma, beside_shot), how=how) if not level else bound

    def explain(self, s: Situation) -> str:
        variance = speckle_variance(s)
        if not variance:
            return "none is left"
        width, freedom = math.sqrt(variance), 1 / variance
        return f"on a pixel the light varies by {width:.2g}: {freedom:.3g} degrees of freedom"
