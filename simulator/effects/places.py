"""The PSF changes over the field where the panel stands apart from the lens."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from simulator.effects.blurs import Blurring, spread_otherwise
from simulator.effects.costs import PLACE, PLACES
from simulator.effects.limits import lit_otherwise
from simulator.planning import Bound

if TYPE_CHECKING:
    from simulator.situation import Situation

_FALLS = (1.0, 0.5, 0.15)
"""Audited: of the largest change, what so many Chebyshev nodes leave."""


class FieldPosition(Blurring):
    name = PLACE
    kind = "axis"
    entry, values = "places", PLACES
    physics = "the stop's shadow moves over the panel as the point moves over the field"
    source = "thesis §5.3; Trefethen, Approximation Theory and Approximation Practice 8"
    levels = ("1", "3x3", "5x5", "9x9")

    def caused(self, s: Situation) -> bool:
        return bool(s.camera.separation) and not s.picture.dark

    def coarser(self, s: Situation, level: int) -> Bound:
        area = lit_otherwise(s)
        change = (2 * math.sqrt(area) + area) * _FALLS[level]
        how = "proved: Cauchy-Schwarz; the panel's area that isn't lit alike"
        if level:
            how = f"audited ×{_FALLS[level]:g} of that: Chebyshev nodes in the field"
        return spread_otherwise(s, change, how)

    def why(self, s: Situation) -> str:
        return f"from the axis to a corner {lit_otherwise(s):.2g} of the lit panel changes"
