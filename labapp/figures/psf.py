"""What a PSF costs at three tolerances, and whether they are kept."""

from __future__ import annotations

import math
import statistics
import time
from pathlib import Path

import numpy as np
import torch

from labapp.figures import Figure
from labapp.figures.quadrature import round_lens_picture
from optics.camera import Lens
from optics.plane import Plane
from optics.psf import PSFOperator

_LENS = Lens(focal_length=0.1, f_number=5.6, focus_distance=math.inf)
_DISTANCE, _WAVELENGTH, _PITCH, _SIDE = 2.0, 520e-9, 3.45e-6, 256
_GOALS = {1e-3: 25, 1e-6: 50, 1e-9: 100}
"""Tolerance to milliseconds of processor time, one thread, once it is planned."""

_REPEATS = 15


def psf_cost(folder: Path) -> list[Figure]:
    """A 100 mm f/5.6 lens focused at infinity, an object at 2 m: 38 waves of defocus."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        return _measure()
    finally:
        torch.set_num_threads(before)


def _measure() -> list[Figure]:
    pixels = Plane((_SIDE, _SIDE), (_PITCH, _PITCH))
    truth = round_lens_picture(_LENS, _DISTANCE, _WAVELENGTH, _PITCH, _SIDE)
    operators = {
        tol: PSFOperator(_LENS, _DISTANCE, _WAVELENGTH, pixels, integrate=False, tol=tol)
        for tol in _GOALS
    }
    spent: dict[float, list[float]] = {tol: [] for tol in _GOALS}
    for _ in range(_REPEATS):
        for tol, operator in operators.items():
            started = time.process_time()
            operator()
            spent[tol].append(1e3 * (time.process_time() - started))
    times = {tol: statistics.median(values) for tol, values in spent.items()}
    errors = {
        tol: float(np.linalg.norm(operator().numpy() - truth) / np.linalg.norm(truth))
        for tol, operator in operators.items()
    }
    kept = all(errors[tol] <= tol and times[tol] <= goal for tol, goal in _GOALS.items())
    return [
        Figure(
            "PSF of a lens 38 waves out of focus, 256², tol 1e-3 / 1e-6 / 1e-9",
            " / ".join(str(goal) for goal in _GOALS.values()) + " ms at most, tol kept",
            " / ".join(f"{t:.1f}" for t in times.values())
            + " ms, errors "
            + " / ".join(f"{error:.0e}" for error in errors.values()),
            kept,
        )
    ]
