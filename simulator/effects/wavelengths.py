"""The filter's band: how many wavelengths stand for it."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.effects.blurs import NOTHING, hiding, relative
from simulator.effects.costs import BAND, WAVELENGTHS, added
from simulator.effects.limits import contrast, energy
from simulator.effects.on_pixels import in_proportion, light, seconds
from simulator.effects.spectra import Measure, colours, measure
from simulator.planning import Bound, Effect

if TYPE_CHECKING:
    from simulator.recipe import Recipe
    from simulator.situation import Situation

Array = NDArray[np.float64]

_SHARES = (0.3, 0.1, 0.05, 0.02, 0.01, 5e-3, 2e-3, 1e-3, 5e-4, 2e-4, 1e-4)
"""Of the light that falls beyond the rings into which a PSF is cut."""

_CONVERGED = 2e-5
"""Relative change from which on more nodes are no finer."""

_MARGIN = 2.0


class Bandwidth(Effect):
    """A PSF grows with the wavelength, and a pattern's phase falls with it."""

    name = BAND
    kind = "axis"
    physics = "each wavelength of the band has a PSF of its own, wider and less turned"
    source = "Golub and Welsch 1969; Goodman, Introduction to Fourier Optics 6.1"
    levels = tuple(str(n) for n in WAVELENGTHS)

    def caused(self, s: Situation) -> bool:
        return not s.picture.dark and not measure(s, "band").empty

    def finest(self, s: Situation) -> int:
        return len(_changes(s)) - 1

    def estimate(self, s: Situation, level: int) -> float:
        return 0.3 * relative(s, self.bound(s, level))

    def bound(self, s: Situation, level: int) -> Bound:
        if level >= self.finest(s):
            return NOTHING
        change = _changes(s)[level]
        how = f"audited ×{_MARGIN:g}: quadrature of exp(i 2π k r λ) for the light up to each r"
        return in_proportion(s, hiding(s) * change, how)

    def work(self, s: Situation, levels: Mapping[str, int]) -> float:
        return added(s, levels, self.name)

    def why(self, s: Situation) -> str:
        width = s.band.fwhm * 1e9
        return f"a band of {width:.3g} nm around {s.wavelength * 1e9:.4g} nm scales the PSF"

    def apply(self, recipe: Recipe, s: Situation, level: int) -> Recipe:
        return recipe.having(wavelengths=WAVELENGTHS[level])


def _changes(s: Situation) -> tuple[float, ...]:
    """Electrons, L2, of each level down from 1 node until it has converged; a coarser level is
    never told to be better than a finer one."""
    known = s.pattern.kept.get(_causes(s))
    if known is None:
        known = s.pattern.kept[_causes(s)] = _rates(s)
    return tuple(seconds(s) * one for one in known)


def _causes(s: Situation) -> Hashable:
    """What it follows from besides the pattern; not the exposure, but what that moves."""
    moving = s.exposure if s.target.moves else None
    return s.picture, s.band, s.camera, s.mount, moving


def _rates(s: Situation) -> tuple[float, ...]:
    """Electrons per second."""
    found, whole, changes = measure(s, "band"), light(s) / max(seconds(s), 1e-300), []
    for count in WAVELENGTHS:
        changes.append(_change(s, found, count))
        if changes[-1] <= _CONVERGED * whole:
            break
    return tuple(np.maximum.accumulate(changes[::-1])[::-1].tolist())


def _change(s: Situation, found: Measure, count: int) -> float:
    """Electrons per second, L2, that so few nodes make wrong at most: of the PSF's rings by
    frequency up to some radius, and of what falls beyond by how much it is."""
    path, errors = _path(s), found.errors(count)
    best, resolved, left = light(s) / max(seconds(s), 1e-300), 0.0, 1.0
    for share in (*_SHARES, 0.0):
        # All of the middle order's light lies within half a period along each axis.
        radius = s.pattern.reach(share) if share else s.pattern.period / math.sqrt(2)
        for parts, profile in colours(s):
            wrong = errors[parts].max(axis=0)
            resolved += profile.changed(_gain(s, found, wrong, radius, path, left))
        beyond = math.sqrt(energy(s, radius)) * s.picture.whole if share else 0.0
        best, left = min(best, resolved + 2 * beyond), share
    return _MARGIN * best


def _gain(
    s: Situation, found: Measure, errors: Array, radius: float, path: float, share: float
) -> Callable[[Array], Array]:
    """On the frequencies of a ring of the PSF with a share of its light."""

    def gain(k: Array) -> Array:
        # A phase goes with 1/λ; near the centre that is as far as with λ.
        shift = 2 * math.pi * k * radius + path
        wrong = found.error(errors, shift.ravel(), s.wavelength).reshape(k.shape)
        # Even light has no fringes: nothing is wrong with it but what rounding is.
        return np.where(k > 0, wrong * np.minimum(share, contrast(s, k)), 0.0)

    return gain


def _path(s: Situation) -> float:
    """Radians that the shown phases span."""
    return max(float(one.max() - one.min()) for one in s.pattern.phases)
