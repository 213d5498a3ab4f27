"""Photographs blurred at random, on which restorations are fitted and checked."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from figures.blind import known_kernels
from figures.photographs import Array, grey_pictures
from labapp.accuracy.blurs import (
    SimulatedPhotograph,
    circle,
    disk,
    gaussian,
    shake,
    simulate_photograph,
)
from optics.inverse.blur import Border

FITTED, CHECKED = ("kodak", "bsds500_train"), ("set12", "mcmaster", "cbsd68")
"""Collections that lie beside the checkout: what is fitted sees the first alone."""

_SIDES = (192, 256, 384)
_LEAST_CONTRAST = 0.03

_RING = Path(__file__).parents[3] / (
    "shared/data/thesis/phase_retrieval/results/phase_pattern_images/r_30p/"
    "slmPSF_gaussianRing_iter_569(min_constraint).png"
)


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def thesis_ring() -> Array:
    """The thesis' ring of 30 pixels with its speckles, where it lies beside the checkout."""
    stored = cv2.imread(str(_RING), cv2.IMREAD_GRAYSCALE)
    if stored is None:
        return circle(30.0, 0.05)
    middle = stored[960 - 42 : 960 + 43, 960 - 42 : 960 + 43].astype(np.float64)
    return np.asarray(middle / middle.sum())


def random_psf(rng: np.random.Generator) -> tuple[str, Array]:
    """A disk, a ring, a Gaussian, a known or drawn shake, or the thesis' ring."""
    kind = rng.choice(["disk", "ring", "gaussian", "known", "shake", "thesis"])
    if kind == "disk":
        return kind, disk(log_uniform(rng, 1.2, 10))
    if kind == "ring":
        return kind, circle(rng.uniform(4, 30), float(rng.choice([0, 0.05, 0.1, 0.3])))
    if kind == "gaussian":
        return kind, gaussian(rng.uniform(0.7, 3))
    if kind == "known":
        kernels = known_kernels(rng)
        return kind, kernels[rng.integers(len(kernels))]
    if kind == "shake":
        return kind, shake(rng.uniform(8, 40), int(rng.integers(1000)))
    return kind, thesis_ring()


def random_cases(seed: int, names: tuple[str, ...]) -> Iterator[SimulatedPhotograph]:
    """Without end: a square of one of the collections' pictures, noise 0.001 to 0.03, one border
    of seven periodic."""
    rng, pictures = np.random.default_rng(seed), grey_pictures(names)
    while True:
        scene = pictures[rng.integers(len(pictures))]
        name, psf = random_psf(rng)
        side = int(rng.choice(_SIDES)) + max(psf.shape) - 1
        y, x = (int(rng.integers(n - min(side, n) + 1)) for n in scene.shape)
        scene = scene[y : y + side, x : x + side]
        noise, number = log_uniform(rng, 0.001, 0.03), int(rng.integers(1 << 31))
        border: Border = "periodic" if rng.random() < 0.15 else "unknown"
        if min(scene.shape) < max(psf.shape) + 100 or scene.std() < _LEAST_CONTRAST:
            continue
        yield simulate_photograph(name, scene, psf, noise, number, border)
