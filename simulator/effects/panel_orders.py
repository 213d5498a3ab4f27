"""Diffraction orders of the panel's pixel grid."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from optics.plane import Plane
from simulator.convolution import convolve_valid
from simulator.effects.electron_bounds import max_light_seconds
from simulator.effects.landed_light import cell_pixels, detail_factor, kernel_over_band
from simulator.effects.light_effects import FAR, BlurEffect, light_share_bound, transfer_error_bound
from simulator.effects.psf_bounds import can_orders_reach_sensor, has_occlusion
from simulator.effects.rendering_work import LEVELS, PANEL_ORDERS, PSF_REACH, are_orders_coarse
from simulator.effects.result_cache import cached_across_exposures
from simulator.formation.coarse_orders import order_cell_pixels
from simulator.formation.windows import ORDER_FADE_PIXELS, max_blur_distance
from simulator.planning import Bound
from simulator.recipe import Recipe
from simulator.situation import Situation

_MARGIN, _LIKELY_MARGIN = 1.5, 2.0  # factors of the error bound and of the estimate, from audits


class PanelOrders(BlurEffect):
    """The side orders of the panel's pixel grid, which hold copies of the picture."""

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
        probe = s.pattern_probe
        lost = probe.beyond_orders(lowest) - probe.beyond_orders(LEVELS.orders[-1])
        how = f"audited ×{_MARGIN:g}: Young; light that one pixel's square sends there"
        missing = light_share_bound(s, _MARGIN * max(lost, 0.0), how)
        if not coarse:
            return missing
        # A cell's mean, and the line between the middles of two cells, each take (π k c)²/6 of a
        # fringe of k cycles per metre, for cells of a side c along both axes; what cells don't
        # resolve may be aliased as well.
        share, cell = probe.side_order_share, order_cell_pixels(s) * s.camera.sensor.pitch

        def gain(k: NDArray[np.float64]) -> NDArray[np.float64]:
            return share * np.minimum((math.pi * k * cell) ** 2 / 2, 2.0)

        how = "audited: what cells of pixels take of the detail in all orders"
        return min(missing, transfer_error_bound(s, gain, how), key=lambda one: one.mean)

    def likely_error(self, s: Situation, level: int) -> Bound:
        told = super().likely_error(s, level)
        # Light that comes through the stop aslant, or that is hidden, isn't estimated.
        if s.camera.separation or has_occlusion(s) or not told.mean:
            return told
        coarse = are_orders_coarse(s, level)
        lowest = 1 if coarse else LEVELS.orders[level] + 1
        # Of orders on cells only the detail that these lose counts: the middles of cells, and the
        # lines between them, take from fringes of up to eight.
        finest = 0.125 / (order_cell_pixels(s) * s.camera.sensor.pitch) if coarse else 0.0
        rate = _ghost_norm(s, lowest)
        change = _LIKELY_MARGIN * max_light_seconds(s) * rate * detail_factor(s, finest)
        how = f"estimated ×{_LIKELY_MARGIN:g}: pictures in orders, on coarse cells of the frame"
        found = self.likely_light_error(s, change, how)
        return min(told, found, key=lambda one: one.mean)

    def add_to_recipe(self, recipe: Recipe, s: Situation, level: int) -> Recipe:
        if are_orders_coarse(s, level):
            return recipe.with_changes(coarse_orders=True)
        return recipe.with_changes(orders=LEVELS.orders[level])

    def explain(self, s: Situation) -> str:
        share, period = s.pattern_probe.side_order_share, s.pattern_probe.period
        return f"{share:.2g} of the light goes aside, by {period * 1e3:.3g} mm and more"


@cached_across_exposures
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
