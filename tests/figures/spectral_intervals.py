"""Estimated errors of spectral restorations beside the true ones, on scenes that are unseen."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import spearmanr

from figures import Figure
from figures.spectral_scenes import (
    SIX_BANDS,
    Array,
    add_peak,
    cave_scene,
    observe,
    published_rings,
    typical_spectra,
)
from optics.multispectral import restore_spectra
from optics.multispectral.error_map import estimate_error_map
from optics.threads import single_threaded

_SCENES = ("paints", "feathers", "sponges")
"""Scenes to which nothing was fitted."""
_MEAN_OF = 2
_LIT = 0.1
"""Length of a true spectrum above which a pixel counts as lit."""
_CASES = {"without noise": (0.0, 0.0), "noise 0.01, 20 % unmodulated": (0.01, 0.2)}
"""Noise and unmodulated share of the light."""

_LEAST_SHARE, _LARGEST_SHARE = 0.85, 0.95
_WIDTH_GOAL = 4.0
_RANK_GOAL = 0.3


@dataclass(frozen=True, eq=False)
class _Judged:
    """Of one restoration, by band: shares of lit and of dark pixels within the interval, mean width
    over the rms error, and rank correlation of width and error."""

    lit: Array
    dark: Array
    widths: Array
    ranks: Array


@single_threaded
def interval_figures(folder: Path) -> list[Figure]:
    """Coverage, width and rank correlation of 90 % intervals, for each scene and case."""
    return [_figure(scene, case) for case in _CASES for scene in _SCENES]


def _figure(scene: str, case: str) -> Figure:
    name = f"90 % intervals of six bands of {scene}, {case}"
    goal = (
        f"hold {100 * _LEAST_SHARE:.0f} to {100 * _LARGEST_SHARE:.0f} % of each band's lit and "
        f"dark pixels; width ≤ {_WIDTH_GOAL:g} rms errors; rank correlation ≥ {_RANK_GOAL:g}"
    )
    truth, spectra = cave_scene(scene, mean_of=_MEAN_OF), typical_spectra(SIX_BANDS)
    if truth is None:
        return Figure(name, goal, "not measured: the scene isn't beside the checkout", None)
    if spectra is None:
        return Figure(name, goal, "not measured: colour-science isn't installed", None)
    noise, unmodulated = _CASES[case]
    psfs = add_peak(published_rings(len(SIX_BANDS)), unmodulated)
    observation = observe(truth, psfs, noise=noise)
    restored = restore_spectra(observation, spectra)
    found = estimate_error_map(observation, restored, spectra)
    return _verdict(name, goal, _judge(found.half_width, np.abs(restored.image - truth), truth))


def _judge(half_width: Array, errors: Array, truth: Array) -> _Judged:
    lit = np.linalg.norm(truth, axis=0) > _LIT
    held = errors <= half_width
    rms = np.sqrt((errors**2).mean((1, 2)))
    ranks = [spearmanr(*pair).statistic
             for pair in zip(half_width.reshape(len(truth), -1), errors.reshape(len(truth), -1),
                             strict=True)]  # fmt: skip
    return _Judged(
        held[:, lit].mean(1),
        held[:, ~lit].mean(1) if (~lit).any() else np.empty(0),
        2 * half_width.mean((1, 2)) / rms,
        np.array(ranks),
    )


def _verdict(name: str, goal: str, judged: _Judged) -> Figure:
    shares = np.concatenate([judged.lit, judged.dark])
    met = bool(
        (shares >= _LEAST_SHARE).all()
        and (shares <= _LARGEST_SHARE).all()
        and (judged.widths <= _WIDTH_GOAL).all()
        and (judged.ranks >= _RANK_GOAL).all()
    )
    words = (
        f"lit {_percents(judged.lit)}, dark {_percents(judged.dark)} (bands from 450 to 700 nm); "
        f"width at most {judged.widths.max():.1f} rms errors; rank correlation at least "
        f"{judged.ranks.min():.2f}"
    )
    return Figure(name, goal, words, met)


def _percents(shares: Array) -> str:
    return " ".join(f"{100 * share:.0f}" for share in shares) + " %" if len(shares) else "none"


MEASUREMENTS = {"spectral-intervals": interval_figures}
