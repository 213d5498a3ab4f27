"""The edges of the field are darker."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simulator.effects.blurs import BlurStage, hiding
from simulator.effects.costs import VIGNETTING
from simulator.effects.limits import unequal
from simulator.effects.on_pixels import in_proportion, light
from simulator.planning import Bound

if TYPE_CHECKING:
    from simulator.situation import Situation


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
