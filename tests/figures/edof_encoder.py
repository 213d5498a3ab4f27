"""PSFs behind a pattern, with their gradients: their time beside that of one FFT, and memory."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from figures import Figure
from figures.own_memory import own_memory
from figures.panel_sum import PanelSum
from figures.stopwatch import processor_seconds
from figures.where import ENVIRONMENT, ROOT
from optics.camera import Camera, Lens, Panel, Sensor
from optics.edof.dioptres import PUBLISHED_DISTANCES
from optics.plane import Plane
from optics.psf import PSFOperator, PSFStack
from optics.quarter_symmetry import mirror_quarter, quarter_shape
from optics.threads import single_threaded

_LENS = Lens(0.1, 5.6, math.inf)
_THESIS = Camera(Panel(unmodulated=0.0), _LENS, Sensor(pitch=3.45e-6))
_OTHER = Camera(Panel((720, 1280), 10e-6, 0.87, unmodulated=0.0), _LENS, Sensor(pitch=5e-6))
"""The thesis' camera of chapter 5, and one with a coarser panel and a coarser sensor."""

_WAVELENGTH, _NEAR, _WINDOW, _TOL = 520e-9, 0.5, 901, 1e-3

_FFT_SIDE = 3768
"""Samples along a side of the FFT that the times are compared with: what a window of 1884 samples,
one order of the panel's 8 um, takes with as many zeros again."""

_REPEATS = 7

_TIME_GOALS = {
    "free pattern": 0.35,
    "quarter pattern": 0.06,
    "quarter pattern, ten distances": 0.6,
}
"""Processor time of a PSF at pixels' centres with its gradient, over that of the FFT with its."""

_INTEGRATED_FACTOR = 2.0
"""Factor on these goals for the light on whole pixels."""

_AGREEMENT = 1e-5
_MEMORY_RATIO = 1.5

_ERROR_DISTANCES = (math.inf, 2.0, _NEAR)
_LINES = 101
"""Rows, and columns, of the window at whose crossings the light on whole pixels is judged."""


@single_threaded
def edof_encoder_figures(folder: Path) -> list[Figure]:
    """The thesis' panel of 1080 x 1920 pixels, f = 100 mm, f/5.6, an object at half a metre."""
    return [*_time_figures(), *_error_figures(), _memory_figure()]


def _time_figures() -> Iterator[Figure]:
    """Processor times with gradient, planned before, over that of an FFT in the same run."""
    jobs, goals = {"FFT": _fft_with_gradient()}, dict[str, float]()
    for integrate, factor in ((False, 1.0), (True, _INTEGRATED_FACTOR)):
        where = "on whole pixels" if integrate else "at pixels' centres"
        for name, job in _encoder_jobs(integrate).items():
            jobs[f"{name}, {where}"] = job
            goals[f"{name}, {where}"] = factor * _TIME_GOALS[name]
    for job in jobs.values():
        job()
    spent = processor_seconds(jobs, _REPEATS)
    for name, goal in goals.items():
        ratio = spent[name] / spent["FFT"]
        yield Figure(
            f"PSF with gradient, {name}: time over that of an FFT of {_FFT_SIDE}²",
            f"≤ {goal:g}",
            f"{ratio:.3f}, {1e3 * spent[name]:.0f} ms against {1e3 * spent['FFT']:.0f} ms",
            ratio <= goal,
        )


def _fft_with_gradient() -> Callable[[], object]:
    """A complex64 FFT forward and backward."""
    chance = torch.Generator().manual_seed(0)
    field = torch.randn(_FFT_SIDE, _FFT_SIDE, dtype=torch.complex64, generator=chance)
    slope = field.flip(0)

    def transform() -> torch.Tensor:
        leaf = field.clone().requires_grad_()
        (found,) = torch.autograd.grad(torch.fft.fft2(leaf), leaf, slope)
        return found

    return transform


def _encoder_jobs(integrate: bool) -> dict[str, Callable[[], object]]:
    """Forward and backward computations of PSFs by name; their plans are made before."""
    chance = torch.Generator().manual_seed(1)
    free = _random(_THESIS.panel.shape, chance).float()
    quarter = _random(quarter_shape(_THESIS.panel.shape), chance).float()
    return {
        "free pattern": partial(_gradient, _plan(_THESIS, _NEAR, integrate), free),
        "quarter pattern": partial(_gradient, _plan(_THESIS, _NEAR, integrate, "quarter"), quarter),
        "quarter pattern, ten distances": partial(
            _stack(PUBLISHED_DISTANCES, integrate=integrate).value_and_gradient, quarter, _loss
        ),
    }


def _plan(camera: Camera, distance: float, integrate: bool, symmetry: str = "none") -> PSFOperator:
    return PSFOperator(
        camera,
        distance,
        _WAVELENGTH,
        _window(camera),
        integrate=integrate,
        symmetry=symmetry,
        tol=_TOL,
    )


def _gradient(operator: PSFOperator, phase: torch.Tensor) -> torch.Tensor:
    """The gradient of the loss of a PSF, which takes one pass forward and one backward."""
    leaf = phase.clone().requires_grad_()
    (found,) = torch.autograd.grad(_loss(operator(leaf), 0, 0, 0), leaf)
    return found


def _loss(light: torch.Tensor, distance: int, band: int, field: int) -> torch.Tensor:
    """Sharpness: a loss that every sample of a PSF enters."""
    return light.square().sum()


def _stack(distances: tuple[float, ...], *, integrate: bool) -> PSFStack:
    return PSFStack(
        _THESIS,
        distances,
        [_WAVELENGTH],
        _window(_THESIS),
        symmetry="quarter",
        integrate=integrate,
        tol=_TOL,
    )


def _window(camera: Camera) -> Plane:
    return camera.sensor.window_plane((_WINDOW, _WINDOW))


def _error_figures() -> list[Figure]:
    """Errors against sums over the panel's pixels, and how far both ways are apart."""
    errors, apart, count = {"free": 0.0, "quarter": 0.0}, 0.0, 0
    for number, (camera, distance, integrate) in enumerate(
        product((_THESIS, _OTHER), _ERROR_DISTANCES, (False, True))
    ):
        chance = torch.Generator().manual_seed(number)
        judge = _judge(camera, distance, integrate, chance)
        free = _plan(camera, distance, integrate)
        short = _plan(camera, distance, integrate, "quarter")
        for draw in (_random, _smooth):
            whole = draw(camera.panel.shape, chance)
            errors["free"] = max(errors["free"], judge.error(free(whole), whole))
            quarter = draw(quarter_shape(camera.panel.shape), chance)
            mirrored = mirror_quarter(quarter, camera.panel.shape)
            light = short(quarter)
            errors["quarter"] = max(errors["quarter"], judge.error(light, mirrored))
            apart = max(apart, _relative(light, free(mirrored)))
            count += 1
    cases = f"{count} cases: 2 cameras, 3 distances, random pixels and smooth phases"
    return [
        Figure(
            f"PSF of a {name} pattern, largest error against the sum over panel pixels",
            f"≤ {_TOL:g}, the tolerance",
            f"{error:.1e} in {cases}",
            error <= _TOL,
        )
        for name, error in errors.items()
    ] + [
        Figure(
            "PSF of a mirrored pattern, from its quarter against from all its pixels",
            f"≤ {_AGREEMENT:g} apart",
            f"{apart:.1e} in {count} cases",
            apart <= _AGREEMENT,
        )
    ]


def _judge(camera: Camera, distance: float, integrate: bool, chance: torch.Generator) -> PanelSum:
    """The sum over panel pixels: for all samples at centres, for some of the whole pixels."""
    lines: list[NDArray[np.int64]] = [np.arange(_WINDOW)] * 2
    if integrate:
        lines = [torch.randperm(_WINDOW, generator=chance)[:_LINES].numpy() for _ in lines]
    return PanelSum(camera, distance, _WAVELENGTH, _window(camera), lines[0], lines[1], integrate)


def _random(shape: tuple[int, int], chance: torch.Generator) -> torch.Tensor:
    """Independent phases of all pixels, float64."""
    return 2 * math.pi * torch.rand(shape, generator=chance, dtype=torch.float64)


def _smooth(shape: tuple[int, int], chance: torch.Generator) -> torch.Tensor:
    """A random polynomial of third order with some waves at the edges, float64."""
    y, x = (torch.linspace(-1, 1, n, dtype=torch.float64) for n in shape)
    powers = [(a, b) for a, b in product(range(4), repeat=2) if 0 < a + b <= 3]
    weights = 10 * torch.randn(len(powers), generator=chance, dtype=torch.float64)
    terms = [y[:, None] ** a * x[None, :] ** b for a, b in powers]
    return sum((w * t for w, t in zip(weights, terms, strict=True)), torch.zeros(shape))


def _relative(value: torch.Tensor, truth: torch.Tensor) -> float:
    return float(torch.linalg.norm(value - truth) / torch.linalg.norm(truth))


def _memory_figure() -> Figure:
    """Ten distances beside one, each in a process of its own."""
    one, ten = (_memory_of(count) for count in (1, 10))
    name = "memory of PSFs with gradient, ten distances over one"
    goal = f"≤ {_MEMORY_RATIO:g}"
    if one is None or ten is None:
        return Figure(name, goal, "not measured: this system doesn't tell a process' peak", None)
    return Figure(
        name,
        goal,
        f"{ten / one:.2f}, {ten / 1e6:.0f} MB against {one / 1e6:.0f} MB",
        ten <= _MEMORY_RATIO * one,
    )


def _memory_of(count: int) -> float | None:
    """Bytes that the first computation takes at most, beyond those held before it.

    The C library keeps small pieces of memory that are given back to it, in holes that other arrays
    don't fit. Pieces of their own for all arrays give what is in use.
    """
    answer = subprocess.run(
        [sys.executable, "-m", "figures.edof_encoder", str(count)],
        cwd=ROOT,
        env=ENVIRONMENT | {"OMP_NUM_THREADS": "1", "MALLOC_MMAP_THRESHOLD_": "65536"},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    found: float | None = json.loads(answer.stdout)
    return found


@single_threaded
def _main(count: int) -> None:
    """Print how many bytes the PSFs of some distances take at most; null if that isn't known."""
    stack = _stack(PUBLISHED_DISTANCES[:count], integrate=False)
    chance = torch.Generator().manual_seed(1)
    quarter = _random(quarter_shape(_THESIS.panel.shape), chance).float()
    try:
        # The peak begins anew, so that planning isn't in it.
        Path("/proc/self/clear_refs").write_text("5")
        before = own_memory("VmRSS")
        stack.value_and_gradient(quarter, _loss)
        print(own_memory("VmHWM") - before)
    except OSError:
        print("null")


MEASUREMENTS = {"edof-encoder": edof_encoder_figures}


if __name__ == "__main__":
    _main(int(sys.argv[1]))
