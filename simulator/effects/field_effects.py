"""Effects that vary over the field: the lit part of the panel, and vignetting."""

from __future__ import annotations

import math
from typing import ClassVar

from simulator.effects.blur_effects import (
    BlurEffect,
    OnOffBlurEffect,
    occlusion_factor,
    psf_error_bound,
)
from simulator.effects.electron_bounds import light_norm_bound, proportional_error_bound
from simulator.effects.psf_bounds import illuminated_area_change, max_vignetting_change
from simulator.effects.rendering_work import FIELD_POSITION, LEVELS, VIGNETTING
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
        return psf_error_bound(s, change, how)

    def explain(self, s: Situation) -> str:
        return (
            f"from the axis to a corner {illuminated_area_change(s):.2g} of the lit panel changes"
        )


class Vignetting(OnOffBlurEffect):
    name = VIGNETTING
    recipe_field = "vignetting"
    physics = "off the axis the lens looks smaller, is farther away, and its stop cuts more"
    source = "cos⁴ law; Born and Wolf 4.8.3"

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        how = "proved: Young; the largest loss anywhere in the frame and its margin"
        return proportional_error_bound(
            s, occlusion_factor(s) * max_vignetting_change(s) * light_norm_bound(s), how
        )

    def explain(self, s: Situation) -> str:
        return (
            f"{max_vignetting_change(s):.2g} of the light is lost, or gained, where it differs most"
        )
