"""Random problems: whether tolerances are kept, how often one is refused, and what the choice
of a method costs."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from figures import Figure
from figures.regret import choice_figures, psf_choices
from labapp.accuracy.references.lens_integral import node_count
from labapp.accuracy.references.psf_problem import PSFProblem, PSFReference, window_corner_distance
from labapp.common.speed import machine_speed
from optics.accuracy import Budget, ToleranceError
from optics.camera import Camera, Lens, Panel
from optics.camera.pupil import pupil_amplitude
from optics.camera.stop import Circle, Stop, rectangle, regular_polygon
from optics.plane import Plane
from optics.threads import single_threaded

Array = NDArray[np.float64]

_PROBLEMS = 120
_SEED = 20240607
_JUDGED_TERMS = 6e7
"""Nodes times samples that the judge may sum for one problem."""

_TIMED_TERMS = 2e6
"""Nodes of the judge beyond which methods take minutes to plan."""

_TIMED, _TIMED_SECONDS = 50, 0.2
"""Problems whose choice is measured, and seconds of a call beyond which one isn't."""


def problems(seed: int = _SEED) -> Iterator[PSFProblem]:
    """Without end: focal length 10 mm to 1 m, f/1.4 to f/32, 400 to 1000 nm, object from 0.1 m
    to infinity, pixels of 1 to 20 µm, windows of 32 to 1024, stops, aberrations, SLM phase."""
    rng = np.random.default_rng(seed)
    while True:
        wavelength = rng.uniform(400e-9, 1000e-9)
        focal_length = log_uniform(rng, 0.01, 1.0)
        distance = max(1 / rng.uniform(0, 10), 1.05 * focal_length)
        if rng.random() < 0.15:
            distance = math.inf
        lens = Lens(
            focal_length,
            log_uniform(rng, 1.4, 32.0),
            random_focus(rng, focal_length, distance),
            random_stop(rng),
            random_aberrations(rng, wavelength),
            "stigmatic" if rng.random() < 0.3 else "thin",
        )
        side = int(log_uniform(rng, 32, 1025))
        pitch = log_uniform(rng, 1e-6, 20e-6)
        centre = (0.0, 0.0)
        if rng.random() < 0.25:
            centre = tuple(rng.uniform(-0.5, 0.5, 2) * side * pitch)
        pixels = Plane((side, int(log_uniform(rng, 32, side + 1))), (pitch, pitch), centre)
        integrate, tol = bool(rng.random() < 0.4), log_uniform(rng, 1e-8, 1e-1)
        if rng.random() < 0.25:
            camera, phase = _behind_panel(rng, lens)
            if pupil_amplitude(camera).any():
                yield PSFProblem(camera, distance, wavelength, pixels, integrate, tol, phase)
        else:
            yield PSFProblem(lens, distance, wavelength, pixels, integrate, tol)


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def random_focus(rng: np.random.Generator, focal_length: float, distance: float) -> float:
    near = distance * (1 + 0.01 * rng.uniform())
    anywhere = 1 / rng.uniform(0, 1 / (1.2 * focal_length))
    return [math.inf, near, anywhere][rng.integers(3)]


def random_stop(rng: np.random.Generator) -> Stop:
    kinds = (
        lambda: Stop(),
        lambda: Stop(Circle(), (Circle(rng.uniform(0.1, 0.8)),)),
        lambda: Stop(regular_polygon(int(rng.integers(3, 10)), turn=rng.uniform(0, 1))),
        lambda: Stop(rectangle(rng.uniform(0.3, 1.4), rng.uniform(0.3, 1.4))),
        lambda: Stop(Circle(), (Circle(0.3, (rng.uniform(-0.5, 0.5), 0.1)),)),
        lambda: Stop(Circle(), (rectangle(0.05, 2.2), rectangle(2.2, 0.05))),
    )
    return kinds[rng.integers(len(kinds))]()


def random_aberrations(
    rng: np.random.Generator, wavelength: float
) -> tuple[tuple[int, int, float], ...]:
    possible = [(2, 2), (3, 1), (3, -3), (4, 0), (4, -2), (6, 0), (8, 4)]
    chosen = rng.permutation(len(possible))[: rng.integers(0, 4)]
    return tuple((*possible[i], float(rng.uniform(-0.5, 0.5) * wavelength)) for i in chosen)


def _behind_panel(rng: np.random.Generator, lens: Lens) -> tuple[Camera, Array]:
    shape = (int(rng.integers(60, 400)), int(rng.integers(60, 400)))
    panel = Panel(shape, log_uniform(rng, 4e-6, 20e-6), rng.uniform(0.6, 1.0), unmodulated=0.05)
    return Camera(panel, lens), random_phase(rng, shape)


def random_phase(rng: np.random.Generator, shape: tuple[int, int]) -> Array:
    """Radians: anything at all, a grating, or a cubic."""
    rows, columns = np.indices(shape)
    kinds = (
        rng.uniform(0, 2 * np.pi, shape),
        2 * np.pi * (0.13 * rows + 0.07 * columns),
        40 * ((rows / shape[0] - 0.5) ** 3 + (columns / shape[1] - 0.5) ** 3),
    )
    return np.asarray(kinds[rng.integers(len(kinds))])


@single_threaded
def tolerance_figure(folder: Path) -> list[Figure]:
    """Random problems; each answer is judged where the judge's own sum ends in some seconds."""
    speed = machine_speed()
    budget = Budget(4 << 30, speed)
    accepted = judged = fine = refused_fine = wrong = unreal = 0
    worst = 0.0
    source = problems()
    for _ in range(_PROBLEMS):
        problem = next(source)
        fine += problem.tol >= 1e-6
        try:
            operator = problem.operator(problem.tol, budget=budget)
        except ToleranceError as refusal:
            refused_fine += problem.tol >= 1e-6
            unreal += not floor_is_real(problem, refusal, budget)
            continue
        accepted += 1
        light = problem.light(operator)
        judge = PSFReference(problem, light)
        if judge.product_count > _JUDGED_TERMS:
            continue
        judged += 1
        share = judge.error(light) / problem.tol
        worst, wrong = max(worst, share), wrong + (share > 1)
    return [
        Figure(
            "random PSF problems, tol 1e-1 to 1e-8: answers that keep tol",
            "all",
            f"{judged - wrong} of {judged} judged ({accepted} accepted, {_PROBLEMS} drawn); "
            f"largest error {worst:.2f} tol",
            wrong == 0,
        ),
        Figure(
            "random PSF problems accepted at tol 1e-6 and coarser, 4 GB",
            "≥ 95 %",
            f"{1 - refused_fine / fine:.1%}".replace("%", " %"),
            refused_fine <= 0.05 * fine,
        ),
        Figure(
            "refused problems whose floor the judge finds to be real",
            "all",
            f"{_PROBLEMS - accepted - unreal} of {_PROBLEMS - accepted}",
            unreal == 0,
        ),
    ]


def floor_is_real(problem: PSFProblem, refusal: ToleranceError, budget: Budget) -> bool:
    """Whether a refused problem is beyond what the memory or the arithmetic allow.

    Where memory ran out, the judge too takes more terms than could be held; where a larger
    tol is advised, the answer at that tol is judged, and at a third of it refused.
    """
    words = str(refusal)
    if "ask for tol" not in words:
        corner = window_corner_distance(problem)
        if isinstance(problem.optics, Camera) or "pixels needs" in words:
            return True
        needed = node_count(problem.lens, problem.distance, problem.wavelength, corner)
        return 16 * needed > budget.memory
    advised = float(words.split("ask for tol ")[1].split()[0])
    operator = problem.operator(advised, budget=budget)
    light = problem.light(operator)
    judge = PSFReference(problem, light)
    if judge.product_count <= _JUDGED_TERMS and judge.error(light) > advised:
        return False
    return advised <= 1e-7


@single_threaded
def regret_figure(folder: Path) -> list[Figure]:
    """Every method that meets tol, timed beside the chosen one, where that takes no minutes."""
    budget = Budget(1 << 29, machine_speed())
    figures: list[Figure] = []
    for what, behind_panel in (("PSFs of a lens", False), ("PSFs behind a panel", True)):
        source = (
            one
            for one in problems(_SEED + 1)
            if one.tol >= 1e-6
            and isinstance(one.optics, Camera) == behind_panel
            and _is_timed_soon(one)
        )
        choices = psf_choices(source, budget, _TIMED_SECONDS)
        figures += choice_figures(what, list(islice(choices, _TIMED)))
    return figures


def _is_timed_soon(problem: PSFProblem) -> bool:
    """Whether a problem is one whose methods take no minutes to plan."""
    corner = window_corner_distance(problem)
    count = node_count(problem.lens, problem.distance, problem.wavelength, corner)
    return count <= _TIMED_TERMS


MEASUREMENTS = {"tolerance": tolerance_figure, "regret": regret_figure}
