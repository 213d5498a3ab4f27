"""The effect of focus drift: lens and mount warm up, and the image leaves the sensor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from simulator.effects.focus_shift import FocusShift, far_field_change
from simulator.effects.pupil_rim import rim_displacement
from simulator.effects.result_cache import cached_across_exposures
from simulator.situation import Situation

Array = NDArray[np.float64]


class FocusDrift(FocusShift):
    name = "focus drift"
    likely_shares = (0.8,)
    recipe_field = "focus_drift"
    physics = "lens and mount expand as they warm up, and carry the image away from the sensor"
    source = "Newton's law of cooling; defocus as for depth layers, Hopkins 1955"

    def is_present(self, s: Situation) -> bool:
        return bool(s.focus_drift) and not s.picture_probe.is_dark

    def explain(self, s: Situation) -> str:
        blur = 2 * rim_displacement(s, s.focus_drift) / s.camera.sensor.pitch
        return (
            f"the image has drifted {s.focus_drift * 1e6:.3g} µm behind the sensor, and is blurred "
            f"over {blur:.2g} pixels"
        )

    def change_rate(self, s: Situation) -> float:
        what = f"{self.name} {s.focus_drift}"
        return cached_across_exposures(s, what, lambda: _change_rate(s))


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
            change = far_field_change(s, number, k.ravel(), apart).reshape(k.shape)
            found = np.minimum(found, change)
        return np.asarray(found)

    return s.picture_probe.change_bound([gain] * len(s.picture_probe.distances))
