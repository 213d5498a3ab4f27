"""Samples of the light in each pixel."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from optics.psf import nyquist_samples
from simulator.effects.blurs import NOTHING, filtered, relative
from simulator.effects.costs import SAMPLES, SAMPLING, added, smallest_above
from simulator.planning import Bound, Effect

if TYPE_CHECKING:
    from simulator.recipe import Recipe
    from simulator.situation import Situation

_FINEST = 4

_TO_SPARE = 1.05
"""Over the samples that resolve the finest fringe of the shortest wavelength."""

_MARGIN = 4.0
"""Audited: what is finer than pixels isn't known of a picture, only its finest octave."""


class Sampling(Effect):
    """Light with fringes that samples don't resolve isn't rendered at all: too few are out of the
    question, whatever the tolerance."""

    name = SAMPLING
    kind = "stage"
    physics = "detail of the object that is finer than the samples looks like coarser detail"
    source = "Shannon; Gaskill, Linear Systems"
    levels = tuple(str(n) for n in SAMPLES)

    def caused(self, s: Situation) -> bool:
        return not s.picture.dark

    def finest(self, s: Situation) -> int:
        return smallest_above(SAMPLES, max(_needed(s), _FINEST))

    def estimate(self, s: Situation, level: int) -> float:
        bound = self.bound(s, level)
        return relative(s, bound) / _MARGIN if math.isfinite(bound.mean) else 1.0

    def bound(self, s: Situation, level: int) -> Bound:
        if level >= self.finest(s):
            return NOTHING
        samples = SAMPLES[level]
        if samples < _needed(s):
            how = "proved: samples that miss the PSF's fringes may make any picture"
            return Bound(math.inf, math.inf, math.inf, how=how)
        octave = 0.25 / s.camera.sensor.pitch

        def gain(k: NDArray[np.float64]) -> NDArray[np.float64]:
            # Of an edge's spectrum, 1/k, cells of a sample's size leave (k / (n - k))² aliased.
            alias = _MARGIN * (0.5 / (samples - 0.5)) ** 2
            return np.where(k >= octave, alias, 0.0)

        return filtered(s, gain, f"audited ×{_MARGIN:g}: what a picture's edges fold back")

    def work(self, s: Situation, levels: Mapping[str, int]) -> float:
        return added(s, levels, self.name)

    def why(self, s: Situation) -> str:
        return f"the PSF's finest fringes need {_needed(s):.2g} samples in a pixel"

    def apply(self, recipe: Recipe, s: Situation, level: int) -> Recipe:
        return recipe.having(finer=max(recipe.finer, SAMPLES[level]))


def _needed(s: Situation) -> float:
    shortest = s.band.support[0]
    if s.band.leak:
        shortest = min(shortest, s.band.leak_range[0])
    return _TO_SPARE * nyquist_samples(s.camera, shortest)
