"""Demosaicing by the joint prior, beside OpenCV's interpolations of the same mosaics."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from figures import Figure
from figures.opencv_demosaicing import INTERPOLATIONS, interpolate_bayer
from figures.photographs import Array, colour_photographs
from optics.inverse import build_mosaic_observation, demosaic
from optics.metrics import psnr
from optics.threads import single_threaded

_PATTERN = ("RG", "GB")

_GOALS = {
    "demosaicing by the joint prior over the best of OpenCV's": (0.0, 2.5),
    "the same with noise .01": (0.01, 2.0),
}
"""Noise, and decibels, median over the photographs."""

_METHODS = ("prior", *INTERPOLATIONS)

_RIM = 8
"""Pixels at the frame's edge that aren't compared: OpenCV copies some of them."""


@single_threaded
def demosaicing_figures(folder: Path) -> list[Figure]:
    """Bayer's mosaic of each photograph, sharp, with and without noise, which nobody tells."""
    pictures = colour_photographs()
    return [_figure(name, pictures, *asked) for name, asked in _GOALS.items()]


def _figure(name: str, pictures: list[Array], noise: float, goal: float) -> Figure:
    found: dict[str, list[tuple[float, float]]] = {method: [] for method in _METHODS}
    for number, picture in enumerate(pictures):
        raw = _mosaic(picture, noise, number)
        for method in _METHODS:
            found[method].append(_judged(raw, picture, method))
    levels = {method: np.array([level for level, _ in rows]) for method, rows in found.items()}
    best = np.max([levels[method] for method in _METHODS if method != "prior"], axis=0)
    gain = float(np.median(levels["prior"] - best))
    words = ", ".join(
        f"{method} {np.median(levels[method]):.1f} dB in "
        f"{np.median([spent for _, spent in rows]) * 1e3:.0f} ms"
        for method, rows in found.items()
    )
    return Figure(
        name,
        f"≥ {goal:g} dB, median",
        f"{gain:+.1f} dB of {len(pictures)} photographs: {words}",
        gain >= goal,
    )


def _mosaic(picture: Array, noise: float, seed: int) -> np.ndarray:
    raw = np.empty(picture.shape[1:])
    for y, row in enumerate(_PATTERN):
        for x, letter in enumerate(row):
            raw[y::2, x::2] = picture["RGB".index(letter), y::2, x::2]
    raw += np.random.default_rng(seed).normal(0, noise, raw.shape)
    return raw.astype(np.float32)


def _judged(raw: np.ndarray, picture: Array, method: str) -> tuple[float, float]:
    """PSNR inside the rim, values cut to 0 to 1; and seconds of the processor."""
    begun = time.process_time()
    if method == "prior":
        restored = demosaic(build_mosaic_observation(raw, _PATTERN))
    else:
        restored = interpolate_bayer(raw, _PATTERN, method)
    spent = time.process_time() - begun
    inside = (..., slice(_RIM, -_RIM), slice(_RIM, -_RIM))
    cut = np.clip(np.asarray(restored)[inside], 0, 1).astype(np.float64)
    return float(psnr(cut, np.ascontiguousarray(picture[inside]))), spent


MEASUREMENTS = {"demosaicing": demosaicing_figures}
