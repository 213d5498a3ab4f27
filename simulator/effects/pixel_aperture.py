"""A pixel sees the mean of the light on its area, not the light at its middle."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.effects.on_pixels import in_proportion, pixels, seconds
from simulator.planning import Bound, Stage

if TYPE_CHECKING:
    from simulator.situation import Situation

_MOST = 1.2173
"""Of |1 - sinc a sinc b|, anywhere."""

_MARGIN = 2.0
"""Audited: light that is finer than the pixels' own Nyquist frequency may carry so much more
than the finest octave that they resolve."""


class PixelAperture(Stage):
    name = "pixel aperture"
    entry = "pixel_aperture"
    last = True
    physics = "a pixel averages the light over its area, which takes contrast from fine detail"
    source = "sinc(p fx) sinc(p fy); Goodman, Introduction to Fourier Optics"

    def caused(self, s: Situation) -> bool:
        return not s.picture.dark

    def missed(self, s: Situation) -> float:
        whole = float(s.picture.l2)
        return float(s.picture.power.changed(self._gain(s))) / whole if whole else 0.0

    def left_out(self, s: Situation) -> Bound:
        resolved = float(s.picture.power.changed(self._gain(s)))
        finest = float(s.picture.power.changed(self._beyond(s)))
        change = math.hypot(resolved, _MARGIN * _MOST * self._aliases(s) * finest)
        return in_proportion(
            s,
            seconds(s) * change,
            f"audited ×{_MARGIN:g}: 1 - sinc sinc ≤ (π p k)²/6 in every frequency",
        )

    def work(self, s: Situation, levels: Mapping[str, int]) -> float:
        return 6.0 * pixels(s) if levels[self.name] else 0.0

    def why(self, s: Situation) -> str:
        pitch = s.camera.sensor.pitch
        share = self.estimate(s, 0)
        return f"pixels of {pitch * 1e6:g} µm would take {share:.2g} of the sharp picture"

    def _gain(self, s: Situation) -> _Gain:
        return _Gain(s.camera.sensor.pitch, 0.0)

    def _beyond(self, s: Situation) -> _Gain:
        return _Gain(s.camera.sensor.pitch, 0.25)

    def _aliases(self, s: Situation) -> float:
        """Root of how many frequencies that the lens passes look the same to the pixels."""
        lens = s.camera.lens
        finest = 2 * lens.sine / s.band.support[0]
        return max(math.ceil(2 * finest * s.camera.sensor.pitch), 1.0)


class _Gain:
    """Of each frequency, what pixels take of it; or, above a share of their own, whether it is."""

    def __init__(self, pitch: float, above: float) -> None:
        self._pitch, self._above = pitch, above

    def __call__(self, frequency: NDArray[np.float64]) -> NDArray[np.float64]:
        relative = frequency * self._pitch
        if self._above:
            return (relative >= self._above).astype(np.float64)
        return np.minimum((np.pi * relative) ** 2 / 6, _MOST)
