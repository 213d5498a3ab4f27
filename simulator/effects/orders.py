"""The diffraction orders of the panel's pixel grid."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from simulator.effects.blurs import NOTHING, relative, spread_otherwise
from simulator.effects.costs import GRID, ORDERS, added
from simulator.effects.limits import orders_near
from simulator.planning import Bound, Effect

if TYPE_CHECKING:
    from simulator.recipe import Recipe
    from simulator.situation import Situation

_MARGIN = 1.5


class PanelOrders(Effect):
    name = GRID
    kind = "axis"
    physics = "the panel's pixels are a grating, and send pale copies of the picture aside"
    source = "Goodman, Introduction to Fourier Optics 4.4"
    levels = ("off", "±1", "±2")
    requires = ("diffraction",)

    def caused(self, s: Situation) -> bool:
        return not s.picture.dark

    def estimate(self, s: Situation, level: int) -> float:
        return 0.3 * relative(s, self.bound(s, level))

    def bound(self, s: Situation, level: int) -> Bound:
        if level >= self.finest(s):
            return NOTHING
        if not orders_near(s):
            return Bound(how="proved: none of them meets the sensor")
        lost = s.pattern.beyond_orders(ORDERS[level]) - s.pattern.beyond_orders(ORDERS[-1])
        how = f"audited ×{_MARGIN:g}: Young; light that one pixel's square sends there"
        return spread_otherwise(s, _MARGIN * max(lost, 0.0), how)

    def work(self, s: Situation, levels: Mapping[str, int]) -> float:
        return added(s, levels, self.name)

    def why(self, s: Situation) -> str:
        return (
            f"{s.pattern.order_light:.2g} of the light goes aside, by "
            f"{s.pattern.period * 1e3:.3g} mm and more"
        )

    def apply(self, recipe: Recipe, s: Situation, level: int) -> Recipe:
        return recipe.having(orders=ORDERS[level])
