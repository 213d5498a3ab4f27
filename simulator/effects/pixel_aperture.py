"""A pixel sees the mean of the light on its area, not the light at its middle."""

from __future__ import annotations

import math

import numpy as np

from simulator.effects.on_pixels import PixelStage, in_proportion, seconds
from simulator.planning import Bound
from simulator.situation import Situation

_MOST = 1.2173
"""Of |1 - sinc a sinc b|, anywhere."""

_MARGIN = 2.0
"""Audited: light that is finer than the pixels' own Nyquist frequency may carry so much more
than the finest octave that they resolve."""


class PixelAperture(PixelStage):
    name = "pixel aperture"
    entry = "pixel_aperture"
    operations = 6.0
    last = True
    physics = "a pixel averages the light over its area, which takes contrast from fine detail"
    source = "sinc(p fx) sinc(p fy); Goodman, Introduction to Fourier Optics"

    def caused(self, s: Situation) -> bool:
        return not s.picture.dark

    def missed(self, s: Situation) -> float:
        return self._resolved(s) / s.picture.l2 if s.picture.l2 else 0.0

    def left_out(self, s: Situation) -> Bound:
        pitch = s.camera.sensor.pitch
        finest = s.picture.power.changed(lambda k: (k * pitch >= 0.25).astype(np.float64))
        change = math.hypot(self._resolved(s), _MARGIN * _MOST * self._aliases(s) * finest)
        return in_proportion(
            s,
            seconds(s) * change,
            f"audited ×{_MARGIN:g}: 1 - sinc sinc ≤ (π p k)²/6 in every frequency",
        )

    def why(self, s: Situation) -> str:
        pitch = s.camera.sensor.pitch
        share = self.estimate(s, 0)
        return f"pixels of {pitch * 1e6:g} µm would take {share:.2g} of the sharp picture"

    def _resolved(self, s: Situation) -> float:
        """What pixels take of the frequencies that they resolve, L2 of electrons per second."""
        pitch = s.camera.sensor.pitch
        return s.picture.power.changed(lambda k: np.minimum((np.pi * k * pitch) ** 2 / 6, _MOST))

    def _aliases(self, s: Situation) -> float:
        """Root of how many frequencies that the lens passes look the same to the pixels."""
        lens = s.camera.lens
        finest = 2 * lens.sine / s.band.support[0]
        return max(math.ceil(2 * finest * s.camera.sensor.pitch), 1.0)
