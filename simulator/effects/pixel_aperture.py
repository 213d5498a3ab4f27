"""The aperture of pixels: each averages the irradiance over its area."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np

from simulator.effects.blur_effects import MAX_SINC_LOSS
from simulator.effects.electron_bounds import (
    PixelwiseEffect,
    finest_octave_norm,
    max_light_seconds,
    proportional_error_bound,
)
from simulator.effects.likely_errors import LightEffect
from simulator.planning import Bound
from simulator.situation import Situation


class PixelAperture(LightEffect, PixelwiseEffect):
    """The average over a pixel's area, which takes contrast from fine detail.

    audit_margin: factor, from audits, by which light above the pixels' Nyquist frequency may exceed
        that in the finest octave that they resolve.
    """

    audit_margin: ClassVar[float] = 2.0
    name = "pixel aperture"
    likely_shares = (0.8,)
    recipe_field = "pixel_aperture"
    operations_per_pixel = 6.0
    assumed_by_other_bounds = True
    physics = "a pixel averages the light over its area, which takes contrast from fine detail"
    source = "sinc(p fx) sinc(p fy); Goodman, Introduction to Fourier Optics"

    def is_present(self, s: Situation) -> bool:
        return not s.picture_probe.is_dark

    def estimated_error_if_omitted(self, s: Situation) -> float:
        return (
            self._resolved_loss(s) / s.picture_probe.norm_bound
            if s.picture_probe.norm_bound
            else 0.0
        )

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        folded = MAX_SINC_LOSS * self._aliases(s) * finest_octave_norm(s)
        change = math.hypot(self._resolved_loss(s), self.audit_margin * folded)
        return proportional_error_bound(
            s,
            max_light_seconds(s) * change,
            f"audited ×{self.audit_margin:g}: 1 - sinc sinc ≤ (π p k)²/6 in every frequency",
        )

    def explain(self, s: Situation) -> str:
        pitch = s.camera.sensor.pitch
        share = self.estimated_error(s, 0)
        return f"pixels of {pitch * 1e6:g} µm would take {share:.2g} of the sharp picture"

    def _resolved_loss(self, s: Situation) -> float:
        """Return the loss at frequencies that pixels resolve, an L2 norm in electrons/s."""
        pitch = s.camera.sensor.pitch
        return s.picture_probe.power_spectrum.filtered_norm_bound(
            lambda k: np.minimum((np.pi * k * pitch) ** 2 / 6, MAX_SINC_LOSS)
        )

    def _aliases(self, s: Situation) -> float:
        """Return the root of how many frequencies alias to one.

        The light's frequencies go up to the lens' limit; those that the pixels don't resolve are
        aliased.
        """
        lens = s.camera.lens
        finest = 2 * lens.image_numerical_aperture / s.band.support[0]
        return max(math.ceil(2 * finest * s.camera.sensor.pitch), 1.0)
