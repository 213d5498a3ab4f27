"""Diffraction orders of the panel's pixel grid."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from optics.plane import Plane
from simulator.effects.blur_effects import (
    BlurEffect,
    light_share_bound,
    transfer_error_bound,
)
from simulator.effects.electron_bounds import max_light_seconds
from simulator.effects.landed_light import cell_pixels, detail_factor, kernel_over_band
from simulator.effects.likely_errors import FAR
from simulator.effects.psf_bounds import can_orders_reach_sensor, has_occlusion
from simulator.effects.rendering_work import (
    LEVELS,
    PANEL_ORDERS,
    PSF_REACH,
    are_orders_coarse,
)
from simulator.effects.result_cache import cached_across_exposures
from simulator.formation.coarse_orders import convolve_valid, order_cell_pixels
from simulator.formation.windows import ORDER_FADE_PIXELS, max_blur_distance
from simulator.planning import Bound
from simulator.probing.sampled_frequencies import Gain
from simulator.recipe import Recipe
from simulator.situation import Situation


class PanelOrders(BlurEffect):
    """The side orders of the panel's pixel grid, which hold copies of the picture.

    audit_margin: factor of the error bound, from audits.
    ghost_margin: factor of the estimate, from audits.
    """

    audit_margin: ClassVar[float] = 1.5
    ghost_margin: ClassVar[float] = 2.0
    name = PANEL_ORDERS
    likely_shares = (0.6,)
    noise_change = FAR
    kind = "axis"
    recipe_field, recipe_values = "orders", LEVELS.orders
    physics = "the panel's pixels are a grating, and send pale copies of the picture aside"
    source = "Goodman, Introduction to Fourier Optics 4.4"
    levels = ("off", "coarse", "±2")
    requires = ("diffraction",)
    # One PSF with all orders takes less work than one for each, and ends where no light is.
    refines = (PSF_REACH,)

    def error_bound_below_finest(self, s: Situation, level: int) -> Bound:
        if not can_orders_reach_sensor(s):
            return Bound(how="proved: none of them meets the sensor")
        coarse = are_orders_coarse(s, level)
        lowest = 0 if coarse else LEVELS.orders[level]
        lost = s.pattern_probe.beyond_orders(lowest) - s.pattern_probe.beyond_orders(
            LEVELS.orders[-1]
        )
        how = f"audited ×{self.audit_margin:g}: Young; light that one pixel's square sends there"
        missing = light_share_bound(s, self.audit_margin * max(lost, 0.0), how)
        if not coarse:
            return missing
        how = "audited: what cells of pixels take of the detail in all orders"
        blurred = transfer_error_bound(s, self._coarse_gain(s), how)
        return min(missing, blurred, key=lambda one: one.mean)

    def _coarse_gain(self, s: Situation) -> Gain:
        """Bound the detail by frequency that orders lose if they are rendered on cells.

        A cell's mean, and the line between the middles of two cells, each take (π k c)²/6 of a
        fringe of k cycles per metre, for cells of a side c along both axes; what cells don't
        resolve may be aliased as well. No more light than is in all side orders is concerned.
        """
        share = s.pattern_probe.side_order_share
        cell = order_cell_pixels(s) * s.camera.sensor.pitch

        def gain(k: NDArray[np.float64]) -> NDArray[np.float64]:
            return share * np.minimum((math.pi * k * cell) ** 2 / 2, 2.0)

        return gain

    def likely_error(self, s: Situation, level: int) -> Bound:
        told = super().likely_error(s, level)
        # Light that comes through the stop aslant, or that is hidden, isn't estimated.
        if s.camera.separation or has_occlusion(s) or not told.mean:
            return told
        coarse = are_orders_coarse(s, level)
        lowest = 1 if coarse else LEVELS.orders[level] + 1
        rate = cached_across_exposures(
            s, f"ghosts from order {lowest}", lambda: _ghost_norm(s, lowest)
        )
        change = self.ghost_margin * max_light_seconds(s) * rate * _detail_factor(s, coarse=coarse)
        how = f"estimated ×{self.ghost_margin:g}: pictures in orders, on coarse cells of the frame"
        found = self.likely_light_error(s, change, how)
        return min(told, found, key=lambda one: one.mean)

    def add_to_recipe(self, recipe: Recipe, s: Situation, level: int) -> Recipe:
        if are_orders_coarse(s, level):
            return recipe.with_changes(coarse_orders=True)
        return recipe.with_changes(orders=LEVELS.orders[level])

    def explain(self, s: Situation) -> str:
        return (
            f"{s.pattern_probe.side_order_share:.2g} of the light goes aside, by "
            f"{s.pattern_probe.period * 1e3:.3g} mm and more"
        )


def _ghost_norm(s: Situation, lowest: int) -> float:
    """Estimate the norm of the frame's light in side orders from `lowest` on, electrons/s.

    They hold copies of the picture, most of which miss the frame. Only what cells of the frame hold
    of them counts.
    """
    probe, sensor = s.picture_probe, s.camera.sensor
    step = cell_pixels(s)
    cell = step * sensor.pitch
    rows, columns = (math.ceil(n / step) for n in sensor.shape)
    found = 0.0
    fade = ORDER_FADE_PIXELS * sensor.pitch
    for kernel in s.pattern_probe.side_order_kernels(cell, lowest, LEVELS.orders[-1], fade):
        y, x = (math.ceil(min(far / cell, len(kernel))) + 1 for far in max_blur_distance(s))
        near = kernel_over_band(s, kernel, (y, x))
        down, across = (n // 2 for n in near.shape)
        plane = Plane((rows + 2 * down, columns + 2 * across), (cell, cell))
        ghosts = convolve_valid(probe.light_on(plane), near)
        found = max(found, float(np.linalg.norm(ghosts)))
    return step * found


def _detail_factor(s: Situation, *, coarse: bool) -> float:
    """Return the norm of all light in orders over that which the estimate's cells hold.

    coarse: whether orders are rendered on cells, so that only the detail that these lose counts.
        The middles of cells, and the lines between them, take from fringes of up to eight.
    """
    finest = 0.125 / (order_cell_pixels(s) * s.camera.sensor.pitch) if coarse else 0.0
    return detail_factor(s, finest)
