"""Restorations of five photographs: weights, iterations and tiers on four PSFs and three noises."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from figures import Figure
from figures.photographs import five_squares
from figures.restoration_cases import thesis_ring
from labapp.accuracy.blurs import (
    Array,
    SimulatedPhotograph,
    disk,
    gaussian,
    shake,
    simulate_photograph,
)
from labapp.pictures.networks import bundled_denoiser
from optics.inverse.choice import METHODS, restore
from optics.inverse.total_variation import total_variation
from optics.threads import single_threaded

_SIDE = 320
_NOISES = (0.003, 0.01, 0.03)
_AROUND = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
"""Weights over our own, among which an oracle takes the best, after 30 and 100 iterations."""

_NONE = "not measured: scikit-image isn't installed"
_WHERE = "five photographs of scikit-image, border and noise unknown"


def _psfs() -> dict[str, Array]:
    return {
        "thesis' ring": thesis_ring(),
        "disk of 7": disk(7.0),
        "Gaussian of 2": gaussian(2.0),
        "shake of 30": shake(30.0, 2),
    }


@dataclass(frozen=True, eq=False)
class _Row:
    """A PSF and a noise, with the photographs that they spoil."""

    psf: str
    noise: float
    cases: list[SimulatedPhotograph]


def _rows() -> Iterator[_Row]:
    for name, psf in _psfs().items():
        for noise in _NOISES:
            scenes = five_squares(_SIDE + max(psf.shape) - 1)
            cases = [
                simulate_photograph(name, scene, psf, noise, number)
                for number, scene in enumerate(scenes)
            ]
            yield _Row(name, noise, cases)


def _psnr(case: SimulatedPhotograph, image: object) -> float:
    return case.quality(np.asarray(image))[0]


@single_threaded
def weight_figures(folder: Path) -> list[Figure]:
    """The default against the best weight and number of iterations; with noise told wrongly too."""
    if not five_squares(_SIDE):
        return [Figure("automatic weight: dB below the best", "median ≤ 0.2", _NONE, None)]
    lost, low, high = [], [], []
    for row in _rows():
        each = np.array([_decibels_lost(case) for case in row.cases])
        lost.append(each[:, 0])
        low.append(each[:, 1])
        high.append(each[:, 2])
    own = np.array(lost)
    told = max(float(np.mean(low)), float(np.mean(high))) - float(own.mean())
    median, worst, row_mean = float(np.median(own)), float(own.max()), float(own.mean(1).max())
    return [
        Figure(
            "automatic weight: dB below the best of 7 weights and up to 100 iterations",
            "median ≤ 0.2, worst photograph ≤ 1.0, worst row ≤ 0.5",
            f"median {median:.2f}, worst photograph {worst:.2f}, worst row {row_mean:.2f}; "
            f"12 rows of {_WHERE}",
            median <= 0.2 and worst <= 1 and row_mean <= 0.5,
        ),
        Figure(
            "automatic weight, noise told 5 % too small or too large: dB lost in the mean",
            "≤ 0.5",
            f"{told:.2f} more than with the noise estimated",
            told <= 0.5,
        ),
    ]


def _decibels_lost(case: SimulatedPhotograph) -> tuple[float, float, float]:
    """Decibels below the best: noise estimated, told 5 % too small, and 5 % too large."""
    own = restore(case.problem)
    best = max(
        _psnr(
            case, total_variation(case.problem, (own.weight or 0) * factor, iterations=count).image
        )
        for factor in _AROUND
        for count in (30, 100)
    )
    told = (replace(case.problem, given_noise=share * case.noise) for share in (0.95, 1.05))
    low, high = (best - _psnr(case, restore(one).image) for one in told)
    return best - _psnr(case, own.image), low, high


@single_threaded
def tier_figures(folder: Path) -> list[Figure]:
    """Every method by its defaults, the cheapest tier, and the wide ring with little noise."""
    if not five_squares(_SIDE):
        return [Figure("restorations below the picture as taken", "0", _NONE, None)]
    denoise, below, cheapest, number = bundled_denoiser(), 0, list[float](), 0
    ring: dict[str, list[float]] = {"total-variation": [], "plug-and-play": []}
    for row in _rows():
        for case in row.cases:
            before = _psnr(case, case.observation)
            for name, method in METHODS.items():
                for count in (min(method.gains), method.default_iterations(case.problem)):
                    if name == "l-bfgs-b":
                        continue
                    found = restore(case.problem, None, name, count=count, denoise=denoise)
                    level = _psnr(case, found.image)
                    number, below = number + 1, below + (level < before)
                    if name == "wiener" and count == min(method.gains):
                        cheapest.append(level - before)
                    if name in ring and row.psf == "thesis' ring" and row.noise == 0.003:
                        ring[name].append(level)
    default, dearest = (float(np.mean(levels[1::2])) for levels in ring.values())
    return [
        Figure(
            "restorations below the picture as taken",
            "0",
            f"{below} of {number}: six methods, fewest and usual iterations, 12 rows of {_WHERE}",
            below == 0,
        ),
        Figure(
            "cheapest tier: gain in dB",
            "mean ≥ 1.2",
            f"mean {np.mean(cheapest):.1f}, least {min(cheapest):.1f}",
            float(np.mean(cheapest)) >= 1.2,
        ),
        Figure(
            "thesis' ring, noise .003, mean of five: default / plug-and-play",
            "≥ 25.6 / 26.2 dB",
            f"{default:.1f} / {dearest:.1f} dB",
            default >= 25.6 and dearest >= 26.2,
        ),
    ]


MEASUREMENTS = {"restoration-weights": weight_figures, "restoration-tiers": tier_figures}
