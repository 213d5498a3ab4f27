"""The effect of the diffraction orders of the panel's pixel grid."""

from __future__ import annotations

from typing import ClassVar

from simulator.effects.blur_effects import BlurEffect, psf_error_bound
from simulator.effects.likely_errors import FAR
from simulator.effects.psf_bounds import can_orders_reach_sensor
from simulator.effects.rendering_work import LEVELS, PANEL_ORDERS
from simulator.planning import Bound
from simulator.situation import Situation


class PanelOrders(BlurEffect):
    """The side orders of the panel's pixel grid, which hold copies of the picture.

    audit_margin: factor of the error bound, from audits.
    """

    audit_margin: ClassVar[float] = 1.5
    name = PANEL_ORDERS
    likely_shares = (0.6,)
    noise_change = FAR
    kind = "axis"
    recipe_field, recipe_values = "orders", LEVELS.orders
    physics = "the panel's pixels are a grating, and send pale copies of the picture aside"
    source = "Goodman, Introduction to Fourier Optics 4.4"
    levels = ("off", "±1", "±2")
    requires = ("diffraction",)

    def error_bound_below_finest(self, s: Situation, level: int) -> Bound:
        if not can_orders_reach_sensor(s):
            return Bound(how="proved: none of them meets the sensor")
        lost = s.pattern_probe.beyond_orders(LEVELS.orders[level]) - s.pattern_probe.beyond_orders(
            LEVELS.orders[-1]
        )
        how = f"audited ×{self.audit_margin:g}: Young; light that one pixel's square sends there"
        return psf_error_bound(s, self.audit_margin * max(lost, 0.0), how)

    def explain(self, s: Situation) -> str:
        return (
            f"{s.pattern_probe.side_order_share:.2g} of the light goes aside, by "
            f"{s.pattern_probe.period * 1e3:.3g} mm and more"
        )
