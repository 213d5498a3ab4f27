"""Average the changes that a lens' colours make over the light of band and leak."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from simulator.effects.rendering_work import LEVELS
from simulator.effects.spectra import spectral_measure
from simulator.formation.nodes import gauss_quadrature
from simulator.situation import Situation

Array = NDArray[np.float64]
Which = Literal["band", "leak"]


def mean_change_bound(
    s: Situation, shape: tuple[int, ...], change_at: Callable[[float, Which], Array]
) -> Array:
    """Bound the mean of changes over all light, for any number of wavelengths.

    The result is the largest mean in any channel of any part of the target.
    change_at: returns the changes, an array of the shape, at a wavelength in metres of band or
        leak.
    """
    band = _largest_mean(s, shape, "band", change_at)
    return np.asarray((band + _largest_mean(s, shape, "leak", change_at)).max(-1))


def _largest_mean(
    s: Situation, shape: tuple[int, ...], which: Which, change_at: Callable[[float, Which], Array]
) -> Array:
    """Return the mean changes of each channel of each part over band or leak, (..., rows).

    Each is the largest for any number of wavelengths. The weights are relative to all light of the
    part in its brightest channel.
    """
    measures = [spectral_measure(s, "band"), spectral_measure(s, "leak")]
    found = measures[which == "leak"]
    if found.is_empty:
        return np.zeros((*shape, 1))
    masses = np.sum([one.electrons.sum(-1) for one in measures if not one.is_empty], axis=0)
    brightest = np.maximum(masses.max(0), 1e-300)
    total = np.zeros((*shape, masses.size))
    for count in LEVELS.wavelengths if which == "band" else LEVELS.leak[1:]:
        nodes, weights = gauss_quadrature(found.wavelengths, found.electrons, count)
        shares = np.abs(weights / brightest[:, None]).reshape(-1, len(nodes))
        changes = np.stack([change_at(one, which) for one in nodes.tolist()], axis=-1)
        total = np.maximum(total, changes @ shares.T)
    return total
