"""scikit-image's restorations of the same blurred photograph."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from labapp.accuracy.blurs import Array, SimulatedPhotograph


def restorations(case: SimulatedPhotograph) -> Iterator[tuple[str, int, Callable[[], Array]]]:
    """scikit-image as shipped, in double precision; the frame's opposite edges are neighbours to
    it, or dark to Richardson and Lucy."""
    try:
        restoration: Any = importlib.import_module("skimage.restoration")
    except ImportError as error:
        missing = ValueError(f"scikit-image can't be loaded: {error}; pip install scikit-image")
        yield "scikit-image", 0, partial(_refuse, missing)
        return
    frame, psf = case.observation, case.psf
    for balance in (0.01, 0.1, 1.0):

        def filtered(balance: float = balance) -> Array:
            return np.asarray(restoration.wiener(frame, psf, balance))

        yield f"scikit-image wiener, balance {balance:g}", 1, filtered
    yield (
        "scikit-image unsupervised_wiener",
        1,
        lambda: np.asarray(restoration.unsupervised_wiener(frame, psf, rng=1)[0]),
    )
    for count in (10, 30):

        def likeliest(count: int = count) -> Array:
            return np.asarray(restoration.richardson_lucy(frame, psf, num_iter=count))

        yield f"scikit-image richardson_lucy, {count}", count, likeliest


def _refuse(error: ValueError) -> Array:
    raise error
