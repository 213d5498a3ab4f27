"""The filter: its band, for which a few wavelengths stand, and what it passes beside."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from simulator.effects.blurs import Blurring, hiding, relative, spread_otherwise
from simulator.effects.costs import BAND, BESIDE, LEAK, WAVELENGTHS
from simulator.effects.keeping import kept
from simulator.effects.limits import lit_otherwise
from simulator.effects.on_pixels import in_proportion, light, seconds, through_sensor
from simulator.effects.spectra import leaking, measure
from simulator.formation.windows import span
from simulator.planning import Bound
from simulator.probing.some_frequencies import SomeFrequencies
from simulator.situation import Situation

Array = NDArray[np.float64]

_CONVERGED = 2e-5
"""Relative change from which on more nodes are no finer."""

_MARGIN = 2.0

_UNEVEN = 12.0
"""Audited: by so much more of theirs than all do on the average, dim pixels may change: what is
far from an image is both dim and the first to be wrong."""


class Bandwidth(Blurring):
    """A PSF grows with the wavelength, and a pattern's phase falls with it."""

    name = BAND
    kind = "axis"
    entry, values = "wavelengths", WAVELENGTHS
    physics = "each wavelength of the band has a PSF of its own, wider and less turned"
    source = "Golub and Welsch 1969; Goodman, Introduction to Fourier Optics 6.1"
    levels = tuple(str(n) for n in WAVELENGTHS)

    def caused(self, s: Situation) -> bool:
        return not s.picture.dark and not measure(s, "band").empty

    def finest(self, s: Situation) -> int:
        return len(_changes(s)) - 1

    def coarser(self, s: Situation, level: int) -> Bound:
        change = _changes(s)[level]
        how = f"audited ×{_MARGIN:g}: quadrature of H(k λ) by the far field, at some k"
        return in_proportion(s, hiding(s) * change, how, _UNEVEN)

    def why(self, s: Situation) -> str:
        width = s.band.fwhm * 1e9
        return f"a band of {width:.3g} nm around {s.wavelength * 1e9:.4g} nm scales the PSF"


def _changes(s: Situation) -> tuple[float, ...]:
    """Electrons, L2, of each level down from 1 node until it has converged; a coarser level is
    never told to be better than a finer one."""
    return tuple(seconds(s) * one for one in kept(s, BAND, lambda: _rates(s)))


def _rates(s: Situation) -> tuple[float, ...]:
    """Electrons per second, L2, on some frequencies of the picture."""
    found, plane = measure(s, "band"), s.picture.plane
    most, some = light(s) / max(seconds(s), 1e-300), s.picture.some_frequencies
    if not len(some.ky):
        # Even light has no fringes.
        return (0.0,)
    some = some.and_finer(plane)
    squares = [(parts, some.squares(squared, plane)) for parts, squared in s.picture.colours]
    transfers, changes = _transfers(s, some, found.nodes), []
    for count in WAVELENGTHS:
        wrong, change = found.wrong(count), 0.0
        for parts, power in squares:
            rows = np.unique(wrong[:, parts].reshape(-1, wrong.shape[2]), axis=0)
            apart = max(_squared(transfer, rows, power) for transfer in transfers)
            change += math.sqrt(apart)
        changes.append(min(_MARGIN * _elsewhere(s) * change, most))
        if changes[-1] <= _CONVERGED * most:
            break
    return tuple(np.maximum.accumulate(changes[::-1])[::-1].tolist())


def _squared(transfer: NDArray[np.complex128], wrong: Array, power: Array) -> float:
    """Sum of squares of what weights make wrong of a transfer function, the worst of them.

    transfer: (frequencies, nodes). wrong: (weights, nodes). power: of the frequencies."""
    return float((np.abs(transfer @ wrong.T) ** 2 * power[:, None]).sum(0).max())


def _transfers(s: Situation, some: SomeFrequencies, nodes: Array) -> list[NDArray[np.complex128]]:
    """(frequencies, nodes) of every light that may be, and with parts of the pattern apart by as
    much as half of what it spans.

    A PSF grows with λ, and so its transfer function shrinks; the pattern's phase and the lens'
    aberrations go with 1/λ.
    """
    ky, kx = s.mount.turned_back(some.ky, some.kx)
    grown = nodes / s.wavelength
    far = [s.wavelength / min(nodes[0], s.wavelength) * one for one in span(s)]
    at = s.pattern.transfers_at(ky[:, None] * grown, kx[:, None] * grown, (far[0], far[1]))
    turns = [np.exp(1j * part * _path(s) * (1 / grown - 1)) for part in (0.0, 0.5, -0.5)]
    return [one * turn for one in at for turn in turns]


def _elsewhere(s: Situation) -> float:
    """How much larger a change may be where other parts of the panel are lit: amplitudes add."""
    return (1 + math.sqrt(lit_otherwise(s))) ** 2 if s.camera.separation else 1.0


def _path(s: Situation) -> float:
    """Radians that the phases of pattern and lens span."""
    shown = max(float(one.max() - one.min()) for one in s.pattern.phases)
    bent = max(float(one.max() - one.min()) for one in map(s.pattern.wave, s.pattern.distances))
    return shown + bent


class Leak(Blurring):
    name = BESIDE
    kind = "stage"
    entry, values = "leak", LEAK
    physics = "a filter blocks other wavelengths a thousandfold, not wholly, and there are many"
    source = "thesis §5.6; any filter's data sheet"
    levels = ("off", *(str(n) for n in LEAK[1:]))

    def caused(self, s: Situation) -> bool:
        return bool(s.band.leak) and not s.picture.dark and not measure(s, "leak").empty

    def estimate(self, s: Situation, level: int) -> float:
        return relative(s, self.bound(s, level)) * (1.0 if level == 0 else 0.1)

    def coarser(self, s: Situation, level: int) -> Bound:
        share = leaking(s)
        # All of that light is there, and may be blurred otherwise.
        moved = spread_otherwise(s, 2 * share, "proved: Young; light beside the band moves")
        if level:
            return moved
        how = "proved: Young; electrons beside the band"
        missing = through_sensor(s, hiding(s) * share * light(s), how)
        return max(missing, moved, key=lambda one: one.mean)

    def why(self, s: Situation) -> str:
        low, high = (1e9 * end for end in s.band.leak_range)
        return (
            f"{s.band.leak:.2g} passes from {low:.0f} to {high:.0f} nm, and makes "
            f"{leaking(s):.2g} of the electrons"
        )
