"""What the filter passes beside its band."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simulator.effects.blurs import Blurring, hiding, relative, spread_otherwise
from simulator.effects.costs import BESIDE, LEAK
from simulator.effects.on_pixels import light, through_sensor
from simulator.effects.spectra import leaking, measure
from simulator.planning import Bound

if TYPE_CHECKING:
    from simulator.situation import Situation


class Leak(Blurring):
    name = BESIDE
    kind = "stage"
    entry, values = "leak", LEAK
    physics = "a filter blocks other wavelengths a thousandfold, not wholly, and there are many"
    source = "thesis §5.6; any filter's data sheet"
    levels = ("off", *(str(n) for n in LEAK[1:]))

    def caused(self, s: Situation) -> bool:
        return bool(s.band.leak) and not s.picture.dark and not measure(s, "leak").empty

    def estimate(self, s: Situation, level: int) -> float:
        return relative(s, self.bound(s, level)) * (1.0 if level == 0 else 0.1)

    def coarser(self, s: Situation, level: int) -> Bound:
        share = leaking(s)
        # All of that light is there, and may be blurred otherwise.
        moved = spread_otherwise(s, 2 * share, "proved: Young; light beside the band moves")
        if level:
            return moved
        how = "proved: Young; electrons beside the band"
        missing = through_sensor(s, hiding(s) * share * light(s), how)
        return max(missing, moved, key=lambda one: one.mean)

    def why(self, s: Situation) -> str:
        low, high = (1e9 * end for end in s.band.leak_range)
        return (
            f"{s.band.leak:.2g} passes from {low:.0f} to {high:.0f} nm, and makes "
            f"{leaking(s):.2g} of the electrons"
        )
