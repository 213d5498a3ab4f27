"""What the thesis' own camera costs: its panel 50 mm before its lens, at its ten distances."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from figures import Figure
from figures.chains import ChainProblem
from labapp.common.speed import machine_speed
from optics.accuracy import Budget
from optics.camera import Camera, Lens, Panel
from optics.psf.many import PSFStack
from optics.threads import single_threaded

Array = NDArray[np.float64]

_CAMERA = Camera(Panel(unmodulated=0.0), Lens(0.1, 5.6, 2.0), separation=0.05)
_WAVELENGTH, _SIDE = 520e-9, 256
_DISTANCES = (0.5, 0.62, 0.75, 0.8, 1.0, 1.5, 2.0, 3.5, 5.0, 50.0)
"""Thesis Eq. 5.11, metres."""

_GOALS = {1e-2: 1.5, 1e-3: 4.0}
"""Tolerance to seconds of processor time, one thread, planning included."""

_JUDGED = (0.5, 2.0)
_RATIO = 3.0
_REPEATS = 3


@dataclass(frozen=True)
class _Cost:
    """Processor seconds of ten distances, planned for them and planned before, and the light."""

    whole: float
    call: float
    light: Array


@single_threaded
def thesis_camera_cost(folder: Path) -> list[Figure]:
    """1080 x 1920 pixels of 8 µm, 100 mm f/5.6 focused at 2 m, 520 nm, 256² of 3.45 µm.

    The pattern is a cubic phase (thesis Fig. 5.5), whose exact light is found soon enough: it
    is a product along y and x.
    """
    phase, budget = _cubic(), Budget(speed=machine_speed())
    costs = {tol: _cost(tol, phase, budget) for tol in _GOALS}
    errors = {tol: [0.0] for tol in _GOALS}
    for distance in _JUDGED:
        place = _DISTANCES.index(distance)
        judge = _problem(distance, phase).build_reference(costs[min(costs)].light[place])
        for tol, cost in costs.items():
            errors[tol].append(judge.error(cost.light[place]))
    worst = {tol: max(found) for tol, found in errors.items()}
    kept = all(error <= tol for tol, error in worst.items())
    soon = all(costs[tol].whole <= goal for tol, goal in _GOALS.items())
    ratio = _backward_ratio(phase, budget)
    return [
        Figure(
            "thesis' camera, 50 mm from panel to lens, ten distances, tol 1e-2 / 1e-3",
            " / ".join(f"{goal:g}" for goal in _GOALS.values()) + " s with planning, tol kept",
            f"{_told(costs[tol].whole for tol in _GOALS)} s, once planned "
            f"{_told(costs[tol].call for tol in _GOALS)} s, errors at "
            + " and ".join(f"{distance:g}" for distance in _JUDGED)
            + " m up to "
            + " / ".join(f"{worst[tol]:.0e}" for tol in _GOALS),
            kept and soon,
        ),
        Figure(
            "thesis' camera, forward and backward over forward, ten distances, tol 1e-2",
            f"≤ {_RATIO:g}",
            f"{ratio:.2f}",
            ratio <= _RATIO,
        ),
    ]


def _told(seconds: Iterable[float]) -> str:
    return " / ".join(f"{one:.2f}" for one in seconds)


def _cubic() -> Array:
    y, x = ((np.arange(n) - n // 2) / 1080 for n in _CAMERA.panel.shape)
    return np.asarray(150 * (y[:, None] ** 3 + x**3))


def _problem(distance: float, phase: Array) -> ChainProblem:
    pixels = _CAMERA.sensor.window_plane((_SIDE, _SIDE))
    return ChainProblem(_CAMERA, distance, _WAVELENGTH, pixels, True, min(_GOALS), phase)


def _stack(tol: float, budget: Budget) -> PSFStack:
    pixels = _CAMERA.sensor.window_plane((_SIDE, _SIDE))
    return PSFStack(_CAMERA, _DISTANCES, [_WAVELENGTH], pixels, tol=tol, budget=budget)


def _cost(tol: float, phase: Array, budget: Budget) -> _Cost:
    shown = torch.from_numpy(phase)
    whole = _median(lambda: _stack(tol, budget)(shown))
    stack = _stack(tol, budget)
    light = np.asarray(stack(shown), dtype=np.float64)[:, 0, 0]
    return _Cost(whole, _median(lambda: stack(shown)), light)


def _median(call: Callable[[], object]) -> float:
    """Processor seconds."""
    spent = []
    for _ in range(_REPEATS):
        started = time.process_time()
        call()
        spent.append(time.process_time() - started)
    return statistics.median(spent)


def _backward_ratio(phase: Array, budget: Budget) -> float:
    """Of the gradient of how much light falls into the middle of each picture."""
    stack = _stack(1e-2, budget)
    shown = torch.from_numpy(phase)
    middle = slice(_SIDE // 4, 3 * _SIDE // 4)

    def both() -> None:
        leaf = shown.clone().requires_grad_()
        stack(leaf)[..., middle, middle].sum().backward()

    both()
    return _median(both) / _median(lambda: stack(shown))


MEASUREMENTS = {"thesis-camera": thesis_camera_cost}
