"""The effect of focus drift: lens and mount warm up, and the image leaves the sensor."""

from __future__ import annotations

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
from simulator.effects.pupil_rim import rim_displacement
from simulator.effects.result_cache import cached_across_exposures
from simulator.planning import Bound, OnOffEffect
from simulator.situation import Situation

Array = NDArray[np.float64]

_MARGIN = 1.3
"""Factor of the change that the far field tells, from audits: the panel's effects may change it."""


class FocusDrift(OnOffEffect, LightEffect):
    name = "focus drift"
    likely_shares = (0.8,)
    recipe_field = "focus_drift"
    physics = "lens and mount expand as they warm up, and carry the image away from the sensor"
    source = "Newton's law of cooling; defocus as for depth layers, Hopkins 1955"

    def is_present(self, s: Situation) -> bool:
        return bool(s.focus_drift) and not s.picture_probe.is_dark

    def estimated_error_if_omitted(self, s: Situation) -> float:
        return 0.5 * relative_light_change(s, self._change(s))

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        how = f"audited ×{_MARGIN:g}: phases over the pupil, and transfer functions out of focus"
        return sensor_error_bound(s, self._change(s), how)

    def added_operations(self, s: Situation, levels: Mapping[str, int]) -> float:
        rows, columns = s.camera.panel.shape
        return 60.0 * rows * columns if levels[self.name] else 0.0

    def explain(self, s: Situation) -> str:
        blur = 2 * rim_displacement(s, s.focus_drift) / s.camera.sensor.pitch
        return (
            f"the image has drifted {s.focus_drift * 1e6:.3g} µm behind the sensor, and is blurred "
            f"over {blur:.2g} pixels"
        )

    def _change(self, s: Situation) -> float:
        """Bound the L2 norm of the electrons that the focus drift effect moves."""
        what = f"{self.name} {s.focus_drift}"
        rate = cached_across_exposures(s, what, lambda: _change_rate(s))
        return min(rate * max_light_seconds(s), 2 * light_norm_bound(s))


def _change_rate(s: Situation) -> float:
    """Bound the focus drift effect's change of the light, L2 norm in electrons per second.

    The drift turns phases of two points of the pupil by 2π k ρ at most, where ρ is how far it moves
    light from the rim. Where colour doesn't shift the focus, too, transfer functions change as the
    far field tells it, at the ends of the band by as much more as the wavelength is less (audited).
    """
    moved, probe = rim_displacement(s, s.focus_drift), s.pattern_probe
    low, high = s.band.support
    apart = max(s.wavelength / low, high / s.wavelength)
    # Light that leaks has wavelengths that aren't probed.
    known = not (s.camera.lens.axial_colour or s.band.leak) and s.focus_drift in probe.foci

    def gain(k: Array) -> Array:
        found = np.minimum(2 * np.pi * k * moved, 2.0)
        if known:
            number = probe.foci.index(s.focus_drift)
            change = probe.focus_change(number, k.ravel(), 1.1 * apart).reshape(k.shape)
            found = np.minimum(found, _MARGIN * apart**2 * change)
        return np.asarray(found)

    return s.picture_probe.change_bound([gain] * len(s.picture_probe.distances))
