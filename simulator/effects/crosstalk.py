"""Pixel crosstalk: electrons that are collected in a pixel's neighbours."""

from __future__ import annotations

import math

from optics.sensor.stages import max_contrast_loss
from simulator.effects.electron_bounds import (
    PixelwiseEffect,
    finest_octave_norm,
    light_norm_bound,
    max_light_seconds,
    off_plane_star_electrons,
    relative_light_change,
    sensor_error_bound,
    total_electrons,
)
from simulator.effects.likely_errors import LightEffect
from simulator.planning import Bound
from simulator.situation import Situation


class PixelCrosstalk(LightEffect, PixelwiseEffect):
    name = "pixel crosstalk"
    recipe_field = "crosstalk"
    operations_per_pixel = 8.0
    physics = "light and charge that enter a pixel obliquely are collected by its neighbours"
    source = "Djité et al. 2012, doi 10.1109/TED.2011.2176493"

    def is_present(self, s: Situation) -> bool:
        return s.camera.sensor.crosstalk > 0 and not s.picture_probe.is_dark

    def estimated_error_if_omitted(self, s: Situation) -> float:
        return relative_light_change(s, self._change(s))

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        """Bound the frame's error by the loss of contrast at each frequency.

        No pixel's change and none of the whole picture's is more than the largest loss of contrast,
        and at frequencies that pixels resolve it is the loss there; all light in the finest octave
        that they resolve counts once more, for what is folded back. Dark pixels beside bright ones
        count as they do for veiling glare: |√a - √b|² ≤ |a - b|.
        """
        how = "audited ×1: the loss of contrast by frequency, and at most the largest one"
        change = self._change(s)
        bound = sensor_error_bound(s, change, how)
        slope = bound.variance / change if change else 0.0
        lit = total_electrons(s) + off_plane_star_electrons(s)
        moved = slope * 2 * self._largest_loss(s) * lit
        sigma = min(math.hypot(bound.sigma, math.sqrt(0.1 * moved)), math.sqrt(moved))
        return Bound(bound.mean, bound.variance, sigma, how=how)

    def explain(self, s: Situation) -> str:
        return f"each neighbour in row and column collects {s.camera.sensor.crosstalk:.2g} of it"

    def _largest_loss(self, s: Situation) -> float:
        """Return the largest loss of contrast at any frequency."""
        return 1 - (1 - 4 * s.camera.sensor.crosstalk) ** 2

    def _change(self, s: Situation) -> float:
        """Bound the L2 norm of the electrons that move."""
        most = self._largest_loss(s) * light_norm_bound(s)
        sensor = s.camera.sensor
        if sensor.colour is not None:
            # Pixels behind different filters differ, however smooth the picture is.
            return most
        power = s.picture_probe.power_spectrum
        resolved = power.filtered_norm_bound(
            lambda k: max_contrast_loss(sensor.crosstalk, k, sensor.pitch)
        )
        both = math.hypot(resolved, self._largest_loss(s) * finest_octave_norm(s))
        return min(both * max_light_seconds(s) + off_plane_star_electrons(s), most)
