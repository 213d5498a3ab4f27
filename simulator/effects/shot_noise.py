"""Photons come by chance."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from optics.sensor.chain import FEW
from simulator.effects.on_pixels import (
    FURTHEST,
    brightest,
    dark,
    full,
    held,
    limit,
    near_zero,
    pixels,
    root_pixels,
)
from simulator.planning import Bound, Effect

if TYPE_CHECKING:
    from simulator.recipe import Recipe
    from simulator.situation import Situation

_BELOW = {1: FEW, 2: 60.0, 3: 6000.0}
"""Electrons below which each level draws from Poisson's distribution."""

_DISTANCE = 0.068
"""Of the normal and Poisson's cumulative distributions, times sqrt(electrons): 1/(6 sqrt(2π)) of
Edgeworth's first term, and 2 % for those that follow it from ten electrons on."""


class ShotNoise(Effect):
    name = "shot noise"
    kind = "stage"
    physics = "photons arrive by chance: their number's variance is its mean"
    source = "Poisson; EMVA 1288 release 4, section 2.2; Edgeworth's series for the normal one"
    levels = ("off", "Gaussian", "Poisson below 60", "Poisson below 6000", "Poisson")

    def caused(self, s: Situation) -> bool:
        return held(s) > 0

    def estimate(self, s: Situation, level: int) -> float:
        if level == 0:
            return 1.0
        return self._distance(s, level)

    def bound(self, s: Situation, level: int) -> Bound:
        if level == len(self.levels) - 1:
            return Bound(how="proved: nothing changes")
        return self._normal(s, level) if level else self._none(s)

    def work(self, s: Situation, levels: Mapping[str, int]) -> float:
        level = levels[self.name]
        each = (0.0, 8.0, 9.0, 12.0, 40.0)[level]
        return each * pixels(s)

    def why(self, s: Situation) -> str:
        most, least = brightest(s), dark(s)
        few = "too few for a normal distribution" if least < FEW else "enough for a normal one"
        return (
            f"the brightest pixel holds {most:.3g} electrons and varies by {math.sqrt(most):.2g}; "
            f"the darkest may hold {least:.2g}, {few}"
        )

    def apply(self, recipe: Recipe, s: Situation, level: int) -> Recipe:
        if level == len(self.levels) - 1:
            return recipe.having(shot="Poisson")
        return recipe.having(shot="Gaussian", poisson_below=_BELOW[level])

    def _distance(self, s: Situation, level: int) -> float:
        if level not in _BELOW:
            return 0.0
        few = _BELOW[level]
        return _DISTANCE / math.sqrt(few) if brightest(s) >= few else 0.0

    def _none(self, s: Situation) -> Bound:
        """A variance of the electrons' number, up to a rounding step, and as a knee bends it."""
        sensor, root = s.camera.sensor, root_pixels(s)
        step = sensor.gain
        kinked = 0.5 * math.sqrt(brightest(s) * full(s).count)
        if near_zero(sensor):
            kinked += 0.5 * (sensor.read_noise + FURTHEST * sensor.dsnu) * root
        floor = 1.5 * sensor.read_noise**2 + step**2
        spread = math.sqrt(_l1(s))
        normal = self._normal(s, 1)
        return Bound(
            max(step * root + kinked, normal.mean),
            max(held(s) + step * spread + floor * root, normal.variance),
            max(spread + (step + sensor.read_noise) * root, normal.sigma),
            1.0,
            "proved: the number's variance is its mean",
        )

    def _normal(self, s: Situation, level: int) -> Bound:
        """Means and variances agree but where wells and roundings cut the distributions."""
        few = _BELOW[level]
        if brightest(s) < few:
            return Bound(how="proved: nothing changes")
        sensor, count = s.camera.sensor, root_pixels(s)
        step = sensor.gain / math.sqrt(few)
        most = math.sqrt(brightest(s))
        mean = 0.15 * step + 1e-3
        variance = sensor.gain + 0.2 * sensor.gain * step + 0.05
        sigma = math.sqrt(variance) if sensor.gain**2 > few else variance / math.sqrt(few)
        wells = math.sqrt(full(s).count)
        knee = min(most, math.sqrt(limit(sensor) + 50 * most)) if wells else 0.0
        return Bound(
            mean * count + 0.2 * wells,
            variance * count + 0.6 * knee * wells,
            sigma * count + math.sqrt(0.6 * knee) * wells,
            self._distance(s, level),
            "audited ×1.5: first term of Edgeworth's series",
        )


def _l1(s: Situation) -> float:
    """Sum of all pixels' electrons at most (Cauchy-Schwarz)."""
    return held(s) * root_pixels(s)
