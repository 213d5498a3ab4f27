"""Restorations by heavy tails and within bounds, beside total variation, of one photograph."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labapp.figures import Figure
from labapp.figures.photographs import grey_photograph
from optics.deconvolution.blurred import Blurred
from optics.deconvolution.bounded import bounded
from optics.deconvolution.hyper_laplacian import hyper_laplacian
from optics.deconvolution.measured import measured
from optics.deconvolution.restored import Restored
from optics.deconvolution.total_variation import total_variation
from optics.metrics import psnr
from optics.operators import blur_of
from optics.operators.blur import Border
from optics.threads import single_threaded

Array = NDArray[np.float64]

_RADIUS, _NOISE = 7.0, 0.01

_HYPER_GOAL, _BOUNDED_GOAL = 27.3, 27.0

_SUBPIXELS = 16


@single_threaded
def restoration_figures(folder: Path) -> list[Figure]:
    """A disk of radius 7 in the whole frame of a period, and in the valid part of a larger scene;
    noise and weights found by the methods."""
    ways: dict[str, tuple[float, Callable[[Blurred], Restored]]] = {
        "hyper-Laplacian, power 2/3": (_HYPER_GOAL, lambda seen: hyper_laplacian(seen)),
        "L-BFGS-B within 0 to 1, total variation": (
            _BOUNDED_GOAL,
            lambda seen: bounded(seen, upper=1.0, iterations=100),
        ),
    }
    problems: tuple[Border, ...] = ("periodic", "unknown")
    rows = []
    for name, (goal, way) in ways.items():
        found = {border: (_judged(border, way), _judged(border, total_variation))
                 for border in problems}  # fmt: skip
        rows.append(
            Figure(
                f"{name}: disk r = {_RADIUS:g}, periodic and unknown border, noise {_NOISE:g}",
                f"≥ {goal} dB",
                "; ".join(
                    f"{border} {own[0]:.2f} dB in {own[1] * 1e3:.0f} ms (splitting, total "
                    f"variation, {other[0]:.2f} dB in {other[1] * 1e3:.0f} ms)"
                    for border, (own, other) in found.items()
                ),
                all(own[0] >= goal for own, _ in found.values()),
            )
        )
    return rows


def _judged(border: Border, way: Callable[[Blurred], Restored]) -> tuple[float, float]:
    """PSNR of the whole frame, and seconds of the processor."""
    truth, frame = _photograph(border)
    begun = time.process_time()
    done = way(measured(frame.astype(np.float32), _disk(), border=border))
    spent = time.process_time() - begun
    image = np.clip(done.image.numpy(), 0, 1).astype(np.float64)
    return float(psnr(image, truth)), spent


def _photograph(border: Border) -> tuple[Array, Array]:
    """What was there in the frame, and what was measured of it."""
    scene, psf = grey_photograph(), _disk()
    cut = slice(None) if border == "periodic" else slice(len(psf) // 2, -(len(psf) // 2))
    spread = np.asarray(blur_of(psf, scene.shape, "periodic")(scene))[cut, cut]
    noise = np.random.default_rng(0).normal(0, _NOISE, spread.shape)
    return np.ascontiguousarray(scene[cut, cut]), spread + noise


def _disk() -> Array:
    n = 2 * math.ceil(_RADIUS) + 1
    at = (np.arange(n * _SUBPIXELS) + 0.5) / _SUBPIXELS - n / 2
    inside = (at[:, None] ** 2 + at**2 <= _RADIUS**2).astype(float)
    psf = inside.reshape(n, _SUBPIXELS, n, _SUBPIXELS).mean((1, 3))
    return np.asarray(psf / psf.sum())
