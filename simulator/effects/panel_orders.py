"""The diffraction orders of the panel's pixel grid."""

from __future__ import annotations

from simulator.effects.blur_effects import BlurEffect, psf_error_bound
from simulator.effects.psf_bounds import can_orders_reach_sensor
from simulator.effects.rendering_work import ORDER_COUNTS, PANEL_ORDERS
from simulator.planning import Bound
from simulator.situation import Situation

_MARGIN = 1.5


class PanelOrders(BlurEffect):
    name = PANEL_ORDERS
    kind = "axis"
    recipe_field, recipe_values = "orders", ORDER_COUNTS
    physics = "the panel's pixels are a grating, and send pale copies of the picture aside"
    source = "Goodman, Introduction to Fourier Optics 4.4"
    levels = ("off", "±1", "±2")
    requires = ("diffraction",)

    def error_bound_below_finest(self, s: Situation, level: int) -> Bound:
        if not can_orders_reach_sensor(s):
            return Bound(how="proved: none of them meets the sensor")
        lost = s.pattern_probe.beyond_orders(ORDER_COUNTS[level]) - s.pattern_probe.beyond_orders(
            ORDER_COUNTS[-1]
        )
        how = f"audited ×{_MARGIN:g}: Young; light that one pixel's square sends there"
        return psf_error_bound(s, _MARGIN * max(lost, 0.0), how)

    def explain(self, s: Situation) -> str:
        return (
            f"{s.pattern_probe.side_order_share:.2g} of the light goes aside, by "
            f"{s.pattern_probe.period * 1e3:.3g} mm and more"
        )
