"""Veiling glare: light that lens and camera scatter over the whole sensor."""

from __future__ import annotations

import math

from simulator.effects.electron_bounds import (
    PixelwiseEffect,
    light_norm_bound,
    off_plane_star_electrons,
    pixel_count,
    sensor_error_bound,
    total_electrons,
)
from simulator.effects.vignetting_bounds import unevenness
from simulator.planning import Bound
from simulator.situation import Situation


class VeilingGlare(PixelwiseEffect):
    name = "veiling glare"
    recipe_field = "glare"
    operations_per_pixel = 3.0
    physics = "some of the light is reflected to and fro, and veils the picture evenly"
    source = "ISO 9358:1994, veiling glare index of image-forming systems"

    def is_present(self, s: Situation) -> bool:
        return s.camera.glare > 0 and not s.picture_probe.is_dark

    def estimated_error_if_omitted(self, s: Situation) -> float:
        """Estimate the glare times the sharp picture's relative difference from its mean."""
        if not s.picture_probe.norm_bound:
            return 0.0
        even = s.picture_probe.total**2 / pixel_count(s) / s.picture_probe.norm_bound**2
        return s.camera.glare * unevenness(s) * math.sqrt(max(1 - even, 0.0))

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        """Bound the frame's error by the glare times the picture's difference from its mean.

        A picture differs from its mean by no more than its own norm. Glare gives dark pixels much
        of their light, so that the light of the dim tenth of the picture limits the change of σ in
        the other nine tenths only. In the dim tenth, σ² changes by no more than the variance (|√a -
        √b|² ≤ |a - b|).
        """
        glare = s.camera.glare * unevenness(s)
        how = "proved: the picture against its mean; Cauchy-Schwarz"
        bound = sensor_error_bound(s, glare * light_norm_bound(s), how)
        slope = bound.variance / (glare * light_norm_bound(s)) if bound.variance else 0.0
        moved = slope * glare * (total_electrons(s) + off_plane_star_electrons(s))
        sigma = min(math.hypot(bound.sigma, math.sqrt(0.1 * moved)), math.sqrt(2 * moved))
        return Bound(bound.mean, bound.variance, sigma, how=how)

    def explain(self, s: Situation) -> str:
        return f"{s.camera.glare:.2g} of the light is spread evenly over the sensor"
