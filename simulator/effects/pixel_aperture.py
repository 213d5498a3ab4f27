"""A pixel sees the mean of the light on its area, not the light at its middle."""

from __future__ import annotations

import math

import numpy as np

from simulator.effects.electron_bounds import (
    PixelwiseEffect,
    max_lamp_seconds,
    proportional_error_bound,
)
from simulator.planning import Bound
from simulator.situation import Situation

_MOST = 1.2173
"""Of |1 - sinc a sinc b|, anywhere."""

_MARGIN = 2.0
"""Audited: light that is finer than the pixels' own Nyquist frequency may carry so much more
than the finest octave that they resolve."""


class PixelAperture(PixelwiseEffect):
    name = "pixel aperture"
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
        pitch = s.camera.sensor.pitch
        finest = s.picture_probe.power_spectrum.filtered_norm_bound(
            lambda k: (k * pitch >= 0.25).astype(np.float64)
        )
        change = math.hypot(self._resolved_loss(s), _MARGIN * _MOST * self._aliases(s) * finest)
        return proportional_error_bound(
            s,
            max_lamp_seconds(s) * change,
            f"audited ×{_MARGIN:g}: 1 - sinc sinc ≤ (π p k)²/6 in every frequency",
        )

    def explain(self, s: Situation) -> str:
        pitch = s.camera.sensor.pitch
        share = self.estimated_error(s, 0)
        return f"pixels of {pitch * 1e6:g} µm would take {share:.2g} of the sharp picture"

    def _resolved_loss(self, s: Situation) -> float:
        """What pixels take of the frequencies that they resolve, L2 of electrons per second."""
        pitch = s.camera.sensor.pitch
        return s.picture_probe.power_spectrum.filtered_norm_bound(
            lambda k: np.minimum((np.pi * k * pitch) ** 2 / 6, _MOST)
        )

    def _aliases(self, s: Situation) -> float:
        """Root of how many frequencies that the lens passes look the same to the pixels."""
        lens = s.camera.lens
        finest = 2 * lens.image_numerical_aperture / s.band.support[0]
        return max(math.ceil(2 * finest * s.camera.sensor.pitch), 1.0)
