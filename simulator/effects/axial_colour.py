"""The effect of axial colour: the lens focuses each wavelength at another distance."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from simulator.effects.colour_changes import Which, mean_change_bound
from simulator.effects.focus_shift import FocusShift, far_field_change
from simulator.effects.pupil_rim import rim_displacement
from simulator.effects.result_cache import cached_across_exposures
from simulator.focus import focus_range
from simulator.situation import Situation

Array = NDArray[np.float64]

_BOTH: tuple[Which, Which] = ("band", "leak")


class AxialColour(FocusShift):
    name = "axial colour"
    likely_shares = (0.4,)
    recipe_field = "axial_colour"
    physics = "the lens' glass focuses each wavelength at another distance"
    source = "Kingslake, Lens Design Fundamentals, chapter 4"

    def is_present(self, s: Situation) -> bool:
        return bool(s.camera.lens.axial_colour) and not s.picture_probe.is_dark

    def explain(self, s: Situation) -> str:
        lens, pitch = s.camera.lens, s.camera.sensor.pitch
        most = max(focus_range(lens, *s.band.support), key=abs)
        return (
            f"light of the band is focused up to {most * 1e6:.3g} µm behind the sensor, and "
            f"blurred over {2 * rim_displacement(s, most) / pitch:.2g} pixels"
        )

    def change_rate(self, s: Situation) -> float:
        return cached_across_exposures(s, self.name, lambda: _change_rate(s))


def _change_rate(s: Situation) -> float:
    """Bound the axial colour effect's change of the light, L2 norm in electrons per second.

    The transfer function is a sum over pairs of points of the pupil, whose phases a shift of focus
    turns against each other by 2π k ρ at most, where ρ is how far it moves light from the rim. It
    changes no more than in a focus beyond, as the far field tells it (audited).
    """

    probe = s.picture_probe

    def gain(k: Array) -> Array:
        flat = k.ravel()
        probed = {which: _changes_beyond(s, flat, which) for which in _BOTH}

        def at(wavelength: float, which: Which) -> Array:
            return _turned(s, flat, s.camera.lens.focus_shift(wavelength), probed[which])

        found = mean_change_bound(s, flat.shape, at)
        return np.asarray(np.minimum(found, 2.0).reshape(k.shape))

    return probe.change_bound([gain] * len(probe.distances))


def _turned(s: Situation, k: Array, shift: float, probed: list[tuple[float, Array]]) -> Array:
    """Bound the change of a transfer function by axial colour's shift of focus, (frequencies,)."""
    found = np.minimum(2 * np.pi * rim_displacement(s, shift) * k, 2.0)
    for focus, change in probed:
        if shift * focus > 0 and abs(shift) <= abs(focus) * (1 + 1e-9):
            found = np.minimum(found, change)
    return found


def _changes_beyond(s: Situation, k: Array, which: Which) -> list[tuple[float, Array]]:
    """Return the foci that were probed for axial colour, and the transfer functions' changes there.

    Light of another wavelength than the band's centre has its transfer function at other
    frequencies, and its phase is larger by as much.
    """
    if s.focus_drift:
        return []  # The foci were probed against one that doesn't drift.
    probe, ends = s.pattern_probe, s.band.support if which == "band" else s.band.leak_range
    apart = max(s.wavelength / ends[0], ends[1] / s.wavelength, 1.0)
    foci = probe.foci if which == "band" else (*probe.foci, *probe.leaked_foci)
    return [(focus, far_field_change(s, number, k, apart)) for number, focus in enumerate(foci)]
