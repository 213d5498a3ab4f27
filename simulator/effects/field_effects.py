"""What varies over the field: the lit part of the panel, and vignetting."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np
import torch
from numpy.typing import NDArray

from optics.validation import as_number
from simulator.effects.blur_effects import (
    BlurEffect,
    OnOffBlurEffect,
    light_share_bound,
    occlusion_factor,
)
from simulator.effects.electron_bounds import (
    light_norm_bound,
    max_light_seconds,
    proportional_error_bound,
)
from simulator.effects.psf_bounds import illuminated_area_change
from simulator.effects.rendering_work import FIELD_POSITION, LEVELS, VIGNETTING
from simulator.effects.result_cache import cached_across_exposures
from simulator.effects.vignetting_bounds import vignetting_change
from simulator.formation.windows import light_extent, max_blur_distance
from simulator.planning import Bound
from simulator.situation import Situation


class FieldPosition(BlurEffect):
    """The change of the PSF over the field, as the stop's shadow moves over the panel.

    chebyshev_error_shares: share of the largest change that is left at each level, from audits.
    """

    chebyshev_error_shares: ClassVar[tuple[float, ...]] = (1.0, 0.5, 0.15)
    name = FIELD_POSITION
    kind = "axis"
    recipe_field, recipe_values = "places", LEVELS.places
    physics = "the stop's shadow moves over the panel as the point moves over the field"
    source = "thesis §5.3; Trefethen, Approximation Theory and Approximation Practice 8"
    levels = ("1", "3x3", "5x5", "9x9")

    def is_present(self, s: Situation) -> bool:
        return bool(s.camera.separation) and not s.picture_probe.is_dark

    def error_bound_below_finest(self, s: Situation, level: int) -> Bound:
        area = illuminated_area_change(s)
        change = (2 * math.sqrt(area) + area) * self.chebyshev_error_shares[level]
        how = "proved: Cauchy-Schwarz; the panel's area that isn't lit alike"
        if level:
            share = self.chebyshev_error_shares[level]
            how = f"audited ×{share:g} of that: Chebyshev nodes in the field"
        return light_share_bound(s, change, how)

    def likely_error(self, s: Situation, level: int) -> Bound:
        if level >= self.finest_level(s):
            return Bound()
        rates = cached_across_exposures(s, f"likely {self.name}", lambda: _likely_error_rates(s))
        how = "estimated: transfer functions by the far field along the field's diagonals"
        change = occlusion_factor(s) * max_light_seconds(s) * rates[level]
        return self.likely_light_error(s, change, how)

    def explain(self, s: Situation) -> str:
        return (
            f"from the axis to a corner {illuminated_area_change(s):.2g} of the lit panel changes"
        )


_LIKELY_SHARES = (0.8, 1.0)
"""Share of the change along the frame's diagonals that the picture's error reached at most in
audits of random scenes, with one place and with 3 x 3. More places may do no better than to halve
it again: the stop's shadow has edges, and what moves with an edge isn't smooth."""


def _likely_error_rates(s: Situation) -> tuple[float, ...]:
    """Estimate the L2 errors with few places in the field, electrons/s, for each number of places.

    Transfer functions are compared along a diagonal of the frame: those of the corners with that of
    the axis, and that halfway with the parabola through both corners and the axis.
    """
    plane, some = s.picture_probe.plane, s.picture_probe.sampled_frequencies
    if not len(some.ky):
        return (0.0, 0.0, 0.0)
    squared = torch.stack([squared for _, squared in s.picture_probe.powers_by_spectrum]).sum(0)
    power = some.represented_power(squared, plane)
    corner = _stop_shadow_move(s)
    steps = ((0.0, 0.0), (1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (0.5, 0.5))
    moves = [(y * corner[0], x * corner[1]) for y, x in steps]
    frequencies = s.mount.to_panel_axes(some.ky, some.kx)
    axis_error = parabola_error = 0.0
    for axis, plus, minus, other, half in s.pattern_probe.transfers_behind_moved_stop(
        moves, *frequencies, max_blur_distance(s)
    ):
        for one in (plus, minus, other):
            axis_error = max(axis_error, _filtered_norm(one - axis, power))
        between = 0.375 * plus + 0.75 * axis - 0.125 * minus
        parabola_error = max(parabola_error, _filtered_norm(half - between, power))
    parabola_error = min(parabola_error, axis_error)
    one_place, few = _LIKELY_SHARES
    return one_place * axis_error, few * parabola_error, few * parabola_error / 2


def _filtered_norm(change: NDArray[np.complex128], power: NDArray[np.float64]) -> float:
    """Return the norm of a change of light from that of transfer functions and its power."""
    return math.sqrt(float((np.abs(change) ** 2 * power).sum()))


def _stop_shadow_move(s: Situation) -> tuple[float, float]:
    """Return how far the stop's shadow moves on the panel to the field's outermost light, metres.

    The field is the frame, and the light's extent where that is smaller.
    """
    sensor, lever = s.camera.sensor, as_number(s.camera.separation) / s.camera.lens.image_distance
    sides = zip(sensor.shape, light_extent(s), strict=True)
    half = [min(n * sensor.pitch / 2, lit) * lever for n, lit in sides]
    y, x = s.mount.to_panel_axes(*(np.asarray(one) for one in half))
    return float(y), float(x)


class Vignetting(OnOffBlurEffect):
    name = VIGNETTING
    likely_shares = (0.5,)
    recipe_field = "vignetting"
    physics = "off the axis the lens looks smaller, is farther away, and its stop cuts more"
    source = "cos⁴ law; Born and Wolf 4.8.3"

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        how = "proved: Young; the largest loss in the frame, and where side orders bring light from"
        return proportional_error_bound(
            s, occlusion_factor(s) * vignetting_change(s) * light_norm_bound(s), how
        )

    def explain(self, s: Situation) -> str:
        return f"{vignetting_change(s):.2g} of the light is lost, or gained, where it differs most"
