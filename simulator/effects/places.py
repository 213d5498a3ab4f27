"""The PSF changes over the field where the panel stands apart from the lens."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from simulator.effects.blurs import NOTHING, relative, spread_otherwise
from simulator.effects.costs import PLACE, PLACES, added
from simulator.effects.limits import lit_otherwise
from simulator.planning import Bound, Effect

if TYPE_CHECKING:
    from simulator.recipe import Recipe
    from simulator.situation import Situation

_FALLS = (1.0, 0.5, 0.15)
"""Audited: of the largest change, what so many Chebyshev nodes leave."""


class FieldPosition(Effect):
    name = PLACE
    kind = "axis"
    physics = "the stop's shadow moves over the panel as the point moves over the field"
    source = "thesis §5.3; Trefethen, Approximation Theory and Approximation Practice 8"
    levels = ("1", "3x3", "5x5", "9x9")

    def caused(self, s: Situation) -> bool:
        return bool(s.camera.separation) and not s.picture.dark

    def estimate(self, s: Situation, level: int) -> float:
        return 0.3 * relative(s, self.bound(s, level))

    def bound(self, s: Situation, level: int) -> Bound:
        if level >= self.finest(s):
            return NOTHING
        area = lit_otherwise(s)
        change = (2 * math.sqrt(area) + area) * _FALLS[level]
        how = "proved: Cauchy-Schwarz; the panel's area that isn't lit alike"
        if level:
            how = f"audited ×{_FALLS[level]:g} of that: Chebyshev nodes in the field"
        return spread_otherwise(s, change, how)

    def work(self, s: Situation, levels: Mapping[str, int]) -> float:
        return added(s, levels, self.name)

    def why(self, s: Situation) -> str:
        return f"from the axis to a corner {lit_otherwise(s):.2g} of the lit panel changes"

    def apply(self, recipe: Recipe, s: Situation, level: int) -> Recipe:
        return recipe.having(places=PLACES[level])
