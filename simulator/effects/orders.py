"""The diffraction orders of the panel's pixel grid."""

from __future__ import annotations

from simulator.effects.blurs import Blurring, spread_otherwise
from simulator.effects.costs import GRID, ORDERS
from simulator.effects.limits import orders_near
from simulator.planning import Bound
from simulator.situation import Situation

_MARGIN = 1.5


class PanelOrders(Blurring):
    name = GRID
    kind = "axis"
    entry, values = "orders", ORDERS
    physics = "the panel's pixels are a grating, and send pale copies of the picture aside"
    source = "Goodman, Introduction to Fourier Optics 4.4"
    levels = ("off", "±1", "±2")
    requires = ("diffraction",)

    def coarser(self, s: Situation, level: int) -> Bound:
        if not orders_near(s):
            return Bound(how="proved: none of them meets the sensor")
        lost = s.pattern.beyond_orders(ORDERS[level]) - s.pattern.beyond_orders(ORDERS[-1])
        how = f"audited ×{_MARGIN:g}: Young; light that one pixel's square sends there"
        return spread_otherwise(s, _MARGIN * max(lost, 0.0), how)

    def why(self, s: Situation) -> str:
        return (
            f"{s.pattern.order_light:.2g} of the light goes aside, by "
            f"{s.pattern.period * 1e3:.3g} mm and more"
        )
