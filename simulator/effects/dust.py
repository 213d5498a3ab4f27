"""Dust: shadows of specks on the sensor's cover glass."""

from __future__ import annotations

import math

from simulator.effects.electron_bounds import (
    PixelwiseEffect,
    light_norm_bound,
    off_plane_star_electrons,
    peak_electrons,
    relative_light_change,
    sensor_error_bound,
    total_electrons,
)
from simulator.effects.likely_errors import LightEffect
from simulator.effects.picture_norms import dust_losses
from simulator.planning import Bound
from simulator.situation import Situation


class Dust(LightEffect, PixelwiseEffect):
    name = "dust"
    recipe_field = "dust"
    physics = "specks on the sensor's cover glass hold back some of each pixel's cone of light"
    source = "geometric shadow and penumbra; Gu et al. 2009, doi 10.1145/1661412.1618490"

    def is_present(self, s: Situation) -> bool:
        return bool(dust_losses(s).deepest) and not s.picture_probe.is_dark

    def estimated_error_if_omitted(self, s: Situation) -> float:
        return relative_light_change(s, self._change(s))

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        """Bound the frame's error by the light that all shadows take.

        σ changes by no more than (1 - √(1 - loss)) of that of the light, which is the loss at most.
        """
        how = "proved: shadows on the brightest pixels, and at most the deepest on all"
        change = self._change(s)
        bound = sensor_error_bound(s, change, how)
        slope = bound.variance / change if change else 0.0
        losses, lit = dust_losses(s), total_electrons(s) + off_plane_star_electrons(s)
        of_light = min(losses.norm**2 * peak_electrons(s), losses.deepest**2 * lit)
        sigma = min(math.sqrt(bound.variance * losses.pixels**0.5), math.sqrt(slope * of_light))
        return Bound(bound.mean, bound.variance, sigma, how=how)

    def explain(self, s: Situation) -> str:
        losses = dust_losses(s)
        return (
            f"the deepest shadow takes {losses.deepest:.2g} of a pixel's light, all of them that "
            f"of {losses.total:.3g} pixels"
        )

    def _change(self, s: Situation) -> float:
        """Bound the L2 norm of the electrons that shadows take."""
        losses = dust_losses(s)
        return min(losses.norm * peak_electrons(s), losses.deepest * light_norm_bound(s))
