"""Spectral bands by the published objective with its right gradient, beside `restore_spectra`."""

from __future__ import annotations

import time
from pathlib import Path

from figures import Figure
from figures.spectral_scenes import (
    SIX_BANDS,
    cave_scene,
    mean_level,
    observe,
    published_rings,
    typical_spectra,
)
from optics.multispectral import restore_by_published_objective, restore_spectra
from optics.threads import single_threaded

_SCENE = "paints"
_GOAL = 26.0
_ITERATIONS = 300


@single_threaded
def published_figure(folder: Path) -> list[Figure]:
    """Six bands of a scene by the objective of the thesis, in the published simulation."""
    name = f"six bands of {_SCENE} from one RGGB frame by the objective of the thesis"
    goal = f"≥ {_GOAL:g} dB in ≤ {_ITERATIONS} iterations"
    picture, spectra = cave_scene(_SCENE), typical_spectra(SIX_BANDS)
    if picture is None:
        return [Figure(name, goal, "not measured: the scene isn't beside the checkout", None)]
    if spectra is None:
        return [Figure(name, goal, "not measured: colour-science isn't installed", None)]
    seen = observe(picture, published_rings(len(SIX_BANDS)))
    begun = time.process_time()
    theirs = restore_by_published_objective(seen, iterations=_ITERATIONS)
    between = time.process_time()
    ours = restore_spectra(seen, spectra)
    spent = between - begun, time.process_time() - between
    level = mean_level(theirs.image, picture)
    words = (
        f"{level:.1f} dB, mean of the bands, after {theirs.iterations} iterations of L-BFGS-B in "
        f"{spent[0]:.0f} s; restore_spectra {mean_level(ours.image, picture):.1f} dB in "
        f"{spent[1]:.0f} s"
    )
    return [Figure(name, goal, words, level >= _GOAL and theirs.iterations <= _ITERATIONS)]


MEASUREMENTS = {"spectral-published": published_figure}
