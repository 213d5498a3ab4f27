"""What differs over the field: the panel that a place is seen through, and its brightness."""

from __future__ import annotations

import math

from simulator.effects.blurs import Blurring, BlurStage, hiding, spread_otherwise
from simulator.effects.costs import PLACE, PLACES, VIGNETTING
from simulator.effects.limits import lit_otherwise, unequal
from simulator.effects.on_pixels import in_proportion, light
from simulator.planning import Bound
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


class Vignetting(BlurStage):
    name = VIGNETTING
    entry = "vignetting"
    physics = "off the axis the lens looks smaller, is farther away, and its stop cuts more"
    source = "cos⁴ law; Born and Wolf 4.8.3"

    def left_out(self, s: Situation) -> Bound:
        how = "proved: Young; the largest loss anywhere in the frame and its margin"
        return in_proportion(s, hiding(s) * unequal(s) * light(s), how)

    def why(self, s: Situation) -> str:
        return f"{unequal(s):.2g} of the light is lost, or gained, where it differs most"
