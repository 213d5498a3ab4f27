"""The base of effects that shift the focus, by the wavelength or by time."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from simulator.effects.electron_bounds import (
    light_norm_bound,
    max_light_seconds,
    relative_light_change,
    sensor_error_bound,
)
from simulator.effects.likely_errors import LightEffect
from simulator.planning import Bound, OnOffEffect
from simulator.situation import Situation

Array = NDArray[np.float64]

_MARGIN, _SPREAD = 1.3, 1.1
"""Factor of the change that the far field tells, and of the frequencies near which it is looked
for, from audits: the panel's effects may change a PSF, and its wavelength isn't the band's."""


def far_field_change(s: Situation, number: int, k: Array, apart: float) -> Array:
    """Bound how a focus changes transfer functions near frequencies k, (frequencies,).

    number: of the focus, as for PatternProbe.focus_change(). apart: ratio of wavelengths by which
    light may differ from the band's centre.
    """
    return _MARGIN * apart**2 * s.pattern_probe.focus_change(number, k, _SPREAD * apart)


class FocusShift(OnOffEffect, LightEffect):
    """An effect by which light is focused beside the sensor."""

    @abstractmethod
    def change_rate(self, s: Situation) -> float:
        """Bound the change of the light, L2 norm in electrons per second."""

    def estimated_error_if_omitted(self, s: Situation) -> float:
        return 0.5 * relative_light_change(s, self._change(s))

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        how = f"audited ×{_MARGIN:g}: phases over the pupil, and transfer functions out of focus"
        return sensor_error_bound(s, self._change(s), how)

    def added_operations(self, s: Situation, levels: Mapping[str, int]) -> float:
        rows, columns = s.camera.panel.shape
        return 60.0 * rows * columns if levels[self.name] else 0.0

    def _change(self, s: Situation) -> float:
        """Bound the L2 norm of the electrons that the shift moves."""
        return min(self.change_rate(s) * max_light_seconds(s), 2 * light_norm_bound(s))
