"""The effect of axial colour: the lens focuses each wavelength at another distance."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from optics.colour_curve import colour_curve_range
from simulator.effects.electron_bounds import (
    light_norm_bound,
    max_light_seconds,
    relative_light_change,
    sensor_error_bound,
)
from simulator.effects.likely_errors import LightEffect
from simulator.effects.pupil_rim import rim_displacement
from simulator.effects.rendering_work import LEVELS
from simulator.effects.result_cache import cached_across_exposures
from simulator.effects.spectra import spectral_measure
from simulator.formation.nodes import gauss_quadrature
from simulator.planning import Bound, OnOffEffect
from simulator.situation import Situation

Array = NDArray[np.float64]

_MARGIN, _SPREAD = 1.3, 1.1
"""Factor of the change that the far field tells, and of the frequencies near which it is looked
for, from audits: the panel's effects may change a PSF, and its wavelength isn't the band's."""


class AxialColour(OnOffEffect, LightEffect):
    name = "axial colour"
    likely_shares = (0.4,)
    recipe_field = "axial_colour"
    physics = "the lens' glass focuses each wavelength at another distance"
    source = "Kingslake, Lens Design Fundamentals, chapter 4"

    def is_present(self, s: Situation) -> bool:
        return bool(s.camera.lens.axial_colour) and not s.picture_probe.is_dark

    def estimated_error_if_omitted(self, s: Situation) -> float:
        return 0.5 * relative_light_change(s, self._change(s))

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        how = f"audited ×{_MARGIN:g}: phases over the pupil, and transfer functions out of focus"
        return sensor_error_bound(s, self._change(s), how)

    def added_operations(self, s: Situation, levels: Mapping[str, int]) -> float:
        rows, columns = s.camera.panel.shape
        return 60.0 * rows * columns if levels[self.name] else 0.0

    def explain(self, s: Situation) -> str:
        lens, pitch = s.camera.lens, s.camera.sensor.pitch
        low, high = colour_curve_range(lens.axial_colour, *s.band.support)
        most = max((low, high), key=abs)
        return (
            f"light of the band is focused up to {most * 1e6:.3g} µm behind the sensor, and "
            f"blurred over {2 * rim_displacement(s, most) / pitch:.2g} pixels"
        )

    def _change(self, s: Situation) -> float:
        """Bound the L2 norm of the electrons that the axial colour effect moves."""
        rate = cached_across_exposures(s, self.name, lambda: _change_rate(s))
        return min(rate * max_light_seconds(s), 2 * light_norm_bound(s))


def _change_rate(s: Situation) -> float:
    """Bound the axial colour effect's change of the light, L2 norm in electrons per second.

    The transfer function is a sum over pairs of points of the pupil, whose phases a shift of focus
    turns against each other by 2π k ρ at most, where ρ is how far it moves light from the rim. It
    changes no more than in a focus beyond, as the far field tells it (audited).
    """

    def gain(k: Array) -> Array:
        flat = k.ravel()
        both = _largest(s, flat, "band") + _largest(s, flat, "leak")
        return np.asarray(np.minimum(both.max(1), 2.0).reshape(k.shape))

    probe = s.picture_probe
    return probe.change_bound([gain] * len(probe.distances))


def _largest(s: Situation, k: Array, which: Literal["band", "leak"]) -> Array:
    """Bound the change of each part's transfer function by axial colour, for any number of nodes.

    k: cycles per metre. The result is relative to all light of the part, (frequencies, rows); each
    row is a channel of a part.
    """
    measures = [spectral_measure(s, one) for one in ("band", "leak")]
    masses = sum(one.electrons.sum(-1) for one in measures if not one.is_empty)
    found = measures[which == "leak"]
    if found.is_empty:
        return np.zeros((len(k), 1))
    probed = _changes_beyond(s, k, which)
    brightest = np.maximum(np.max(masses, axis=0), 1e-300)
    total = np.zeros((len(k), masses.size))
    for count in LEVELS.wavelengths if which == "band" else LEVELS.leak[1:]:
        nodes, weights = gauss_quadrature(found.wavelengths, found.electrons, count)
        shares = np.abs(weights / brightest[:, None]).reshape(-1, len(nodes))
        turned = [_turned(s, k, s.camera.lens.focus_shift(one), probed) for one in nodes.tolist()]
        total = np.maximum(total, np.stack(turned, axis=1) @ shares.T)
    return total


def _turned(s: Situation, k: Array, shift: float, probed: list[tuple[float, Array]]) -> Array:
    """Bound the change of a transfer function by axial colour's shift of focus, (frequencies,)."""
    found = np.minimum(2 * np.pi * rim_displacement(s, shift) * k, 2.0)
    for focus, change in probed:
        if shift * focus > 0 and abs(shift) <= abs(focus) * (1 + 1e-9):
            found = np.minimum(found, change)
    return found


def _changes_beyond(
    s: Situation, k: Array, which: Literal["band", "leak"]
) -> list[tuple[float, Array]]:
    """Return the foci that were probed for axial colour, and the transfer functions' changes there.

    Light of another wavelength than the band's centre has its transfer function at other
    frequencies, and its phase is larger by as much.
    """
    probe, ends = s.pattern_probe, s.band.support if which == "band" else s.band.leak_range
    apart = max(s.wavelength / ends[0], ends[1] / s.wavelength, 1.0)
    foci = probe.foci if which == "band" else (*probe.foci, *probe.leaked_foci)
    return [
        (focus, _MARGIN * apart**2 * probe.focus_change(number, k, _SPREAD * apart))
        for number, focus in enumerate(foci)
    ]
