"""Light that the panel doesn't turn: of the other polarisation."""

from __future__ import annotations

from typing import TYPE_CHECKING

from optics.slm.reflection import unturned_share
from simulator.effects.panel_effects import PanelEffect

if TYPE_CHECKING:
    from simulator.situation import Situation


class UnmodulatedLight(PanelEffect):
    name = "unmodulated light"
    field = "unmodulated"
    physics = "light of the polarisation that the crystal doesn't turn ignores the pattern"
    source = "thesis §5.6"

    def change(self, s: Situation) -> tuple[float, str]:
        # All of it, if the cover glass reflected none.
        share = max(unturned_share(s.camera.panel), s.camera.panel.unmodulated)
        return 2 * share, "proved: light that moves counts twice"

    def why(self, s: Situation) -> str:
        share = s.camera.panel.unmodulated
        return f"{share:.1%} of the light ignores the pattern and stays in the centre"
