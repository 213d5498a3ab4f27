"""What a PSF costs at three tolerances, and whether they are kept."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import torch
from judges import View, by_rings

from figures import Figure
from optics.camera import Camera, Lens, Panel
from optics.fourier import ChirpTransform, FourierGeometry, MatrixTransform, plan_transform
from optics.plane import Plane
from optics.psf import PSFOperator
from optics.threads import single_threaded

_LENS = Lens(focal_length=0.1, f_number=5.6, focus_distance=math.inf)
_DISTANCE, _WAVELENGTH, _PITCH, _SIDE = 2.0, 520e-9, 3.45e-6, 256
_GOALS = {1e-3: 25, 1e-6: 50, 1e-9: 100}
"""Tolerance to milliseconds of processor time, one thread, once it is planned."""

_REPEATS = 15


@single_threaded
def psf_cost(folder: Path) -> list[Figure]:
    """A 100 mm f/5.6 lens focused at infinity, an object at 2 m: 38 waves of defocus."""
    pixels = Plane((_SIDE, _SIDE), (_PITCH, _PITCH))
    truth = by_rings(View(_LENS, pixels, _DISTANCE, _WAVELENGTH, integrate=False))
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


@single_threaded
def pixelated_cost(folder: Path) -> list[Figure]:
    """From an SLM pupil of 2232² pixels to 512² samples, in single precision."""
    panel = Plane((2232, 2232), (8e-6, 8e-6))
    geometry = FourierGeometry(panel, Plane((512, 512), (_PITCH, _PITCH)), _WAVELENGTH * 0.1)
    phase = np.random.default_rng(0).uniform(0, 2 * np.pi, panel.shape)
    field = torch.from_numpy(np.exp(1j * phase))
    truth = MatrixTransform(geometry, torch.complex128)(field)
    transform = plan_transform(geometry, torch.complex64, error=1e-5)
    field = field.to(torch.complex64)
    value = transform(field)
    error = _relative(value, truth)
    spent = _median(lambda: transform(field))
    return [
        Figure(
            "pixelated pupil of 2232² to 512² samples, complex64",
            "≤ 45 ms",
            f"{spent:.0f} ms by {transform.name}, error {error:.0e}",
            spent <= 45,
        )
    ]


def _relative(value: torch.Tensor, truth: torch.Tensor) -> float:
    return float(torch.linalg.norm(value - truth) / torch.linalg.norm(truth))


def _median(call: Callable[[], object]) -> float:
    """Milliseconds of processor time."""
    call()
    spent = []
    for _ in range(_REPEATS):
        started = time.process_time()
        call()
        spent.append(1e3 * (time.process_time() - started))
    return statistics.median(spent)


@single_threaded
def single_precision(folder: Path) -> list[Figure]:
    """Intensities and gradients behind a panel of 1080 x 1920 pixels, by every transform."""
    camera, rng = Camera(Panel(unmodulated=0.0), Lens(0.1, 5.6, 2.0)), np.random.default_rng(0)
    pixels = camera.sensor.window_plane((128, 128))
    phase = torch.from_numpy(rng.uniform(0, 2 * np.pi, camera.panel.shape))
    plan = partial(PSFOperator, camera, 2.0, _WAVELENGTH, pixels, integrate=False)
    truth, truth_slope = _with_slope(plan(tol=1e-9, method=MatrixTransform.name), phase)
    errors, slopes = [], []
    for method in (MatrixTransform.name, ChirpTransform.name):
        value, slope = _with_slope(plan(tol=1e-4, method=method), phase)
        errors.append(_relative(value, truth))
        slopes.append(_relative(slope, truth_slope))
    return [
        Figure(
            "arithmetic error of a PSF in float32",
            "≤ 1e-6",
            f"{max(errors):.1e}",
            max(errors) <= 1e-6,
        ),
        Figure(
            "gradient of a PSF in float32 against float64",
            "≤ 1e-5",
            f"{max(slopes):.1e}",
            max(slopes) <= 1e-5,
        ),
    ]


def _with_slope(operator: PSFOperator, phase: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """A PSF, and the gradient in the phase of how far it is from a ring."""
    shown = phase.clone().requires_grad_()
    light = operator(shown)
    y, x = operator.pixels.mesh()
    ring = torch.exp(-(((torch.hypot(y, x) - 1e-4) / 2e-5) ** 2))
    ((light / light.detach().sum() - ring / ring.sum()) ** 2).sum().backward()
    assert shown.grad is not None
    return light.detach(), shown.grad


MEASUREMENTS = {"psf": psf_cost, "pixelated": pixelated_cost, "float32": single_precision}
