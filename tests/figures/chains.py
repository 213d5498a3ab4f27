"""Random chains: whether tolerances are kept where the panel stands apart from its lens, how
often one is refused, and what the choice of a method costs."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from figures import Figure
from figures.problems import (
    log_uniform,
    random_aberrations,
    random_focus,
    random_phase,
    random_stop,
)
from figures.regret import choice_figures, psf_choices
from labapp.accuracy.references.psf_problem import ChainProblem
from labapp.common.speed import machine_speed
from optics.accuracy import Budget, ToleranceError
from optics.camera import Camera, Lens, Panel
from optics.camera.pupil import pupil_amplitude
from optics.plane import Plane
from optics.threads import single_threaded

Array = NDArray[np.float64]

_PROBLEMS, _TIMED = 150, 40
_SEED = 20240711
_JUDGED_TERMS = 6e10
"""Products that the judge may sum for one problem: half a minute."""

_TRIED_MEMORY = 8 << 30
"""Bytes that this machine is trusted to have, for trying out whether as many are enough."""

_TIMED_SECONDS = 0.4
"""Of a call, predicted, beyond which a problem is not timed."""

_STEEPEST = 0.2
"""Tangent of the angle off the axis beyond which no paraxial lens is asked."""

_LIT = 0.85
"""Of the shift at which the panel's shadow leaves the stop."""


def chains(seed: int = _SEED, most: int = 300) -> Iterator[ChainProblem]:
    """Without end: panels of 40 to `most` pixels a side, 1 mm to 0.5 m before lenses of 20 mm
    to 0.5 m, f/2 to f/32, whose stop is half to four times as wide as the panel; points from
    0.1 m to infinity, on the axis and off it; windows of 16 to 256."""
    rng = np.random.default_rng(seed)
    while True:
        problem = _drawn(rng, most)
        if problem is not None and pupil_amplitude(problem.camera).any():
            yield problem


def _drawn(rng: np.random.Generator, most: int) -> ChainProblem | None:
    wavelength = rng.uniform(400e-9, 1000e-9)
    distance = math.inf if rng.random() < 0.15 else 1 / rng.uniform(0, 10)
    camera, phase = _random_camera(rng, wavelength, distance, most)
    sphere = bool(camera.separation and rng.random() < 0.1)
    off_axis = _random_field(rng, camera, distance)
    pixels = _random_window(rng)
    integrate, tol = bool(rng.random() < 0.4), log_uniform(rng, 1e-6, 1e-1)
    if not 20e-3 <= camera.lens.focal_length <= 0.5:
        return None
    return ChainProblem(
        camera, distance, wavelength, pixels, integrate, tol, phase, off_axis, sphere
    )


def _random_camera(
    rng: np.random.Generator, wavelength: float, distance: float, most: int
) -> tuple[Camera, Array]:
    shape = (int(rng.integers(40, most + 1)), int(rng.integers(40, most + 1)))
    unmodulated = 0.05 if rng.random() < 0.5 else 0.0
    panel = Panel(
        shape, log_uniform(rng, 4e-6, 20e-6), rng.uniform(0.6, 1.0), unmodulated=unmodulated
    )
    stop_diameter = max(shape) * panel.pitch * log_uniform(rng, 0.5, 4.0)
    f_number = log_uniform(rng, 2.0, 32.0)
    focal_length = stop_diameter * f_number
    separation = 0.0 if rng.random() < 0.05 else log_uniform(rng, 1e-3, 0.5)
    lens = Lens(
        focal_length,
        f_number,
        random_focus(rng, focal_length, max(distance + separation, 1.05 * focal_length)),
        random_stop(rng),
        random_aberrations(rng, wavelength),
    )
    phase = random_phase(rng, shape)
    if rng.random() < 0.15:
        phase = np.zeros(shape)
    return Camera(panel, lens, separation=separation), phase


def _random_field(rng: np.random.Generator, camera: Camera, distance: float) -> tuple[float, float]:
    """Half of the points on the axis; else up to where hardly any light gets through the stop."""
    angle, share = rng.uniform(0, 2 * np.pi), rng.uniform(0, _LIT)
    if rng.random() < 0.5:
        return 0.0, 0.0
    z1, z2 = camera.separation, camera.lens.image_distance
    spread = 1 + z1 / distance
    half = max(camera.panel.shape) * camera.panel.pitch / 2
    gone = (camera.lens.stop_diameter / 2 + spread * half) / (spread * z1) if z1 else math.inf
    away = share * z2 * min(gone, _STEEPEST)
    return float(away * np.sin(angle)), float(away * np.cos(angle))


def _random_window(rng: np.random.Generator) -> Plane:
    side, pitch = int(log_uniform(rng, 16, 257)), log_uniform(rng, 1e-6, 20e-6)
    centre = (0.0, 0.0)
    if rng.random() < 0.25:
        centre = tuple(rng.uniform(-0.5, 0.5, 2) * side * pitch)
    return Plane((side, int(log_uniform(rng, 16, side + 1))), (pitch, pitch), centre)


@dataclass
class Tally:
    """What became of random problems."""

    drawn: int = 0
    judged: int = 0
    worst: float = 0.0
    wrong: tuple[str, ...] = ()
    refused: int = 0
    unreal: tuple[str, ...] = ()

    @property
    def accepted(self) -> int:
        return self.drawn - self.refused


def tally(
    source: Iterator[ChainProblem], count: int, budget: Budget, most: float = _JUDGED_TERMS
) -> Tally:
    """Ask `count` problems; judge what is accepted and takes no more than `most` terms."""
    found = Tally()
    for number, problem in enumerate(islice(source, count)):
        found.drawn += 1
        try:
            error = judged(problem, budget, most)
        except ToleranceError as refusal:
            found.refused += 1
            if why := unreal(problem, refusal, budget, most):
                found.unreal += (f"{number}: {why}: {problem.description}",)
            continue
        if error is None:
            continue
        found.judged += 1
        found.worst = max(found.worst, error / problem.tol)
        if not error <= problem.tol:
            found.wrong += (f"{number}: {error / problem.tol:.2f} tol: {problem.description}",)
    return found


def judged(problem: ChainProblem, budget: Budget, most: float, **settings: Any) -> float | None:
    """The error of an answer, None where it takes the judge too long; raises ToleranceError."""
    light = problem.light(problem.operator(problem.tol, budget=budget, **settings))
    judge = problem.build_reference(light)
    return judge.error(light) if judge.product_count <= most else None


def unreal(problem: ChainProblem, refusal: ToleranceError, budget: Budget, most: float) -> str:
    """What is untrue about a refusal; "" where it keeps its word.

    Another tol that is advised must be accepted, and kept; more memory that is said to be
    needed must be enough, as far as this can be tried; and no method may serve that wasn't chosen.
    """
    words = str(refusal)
    for method in problem.methods:
        try:
            problem.light(problem.operator(problem.tol, budget=budget, method=method))
        except ValueError:
            continue
        return f"{method} serves"
    try:
        if "ask for tol" in words:
            advised = float(words.split("ask for tol ")[1].split()[0])
            error = judged(replace(problem, tol=advised), budget, most)
            return "" if error is None or error <= advised else f"tol {advised:g} isn't kept"
        if " MB at least" in words:
            needed = int(float(words.split(" MB at least")[0].split()[-1]) + 1) * 1_000_000
            if needed > _TRIED_MEMORY:
                return ""
            problem.operator(problem.tol, budget=replace(budget, memory=needed))
    except ToleranceError as again:
        return f"refused again: {again}"
    return ""


@single_threaded
def chain_tolerance_figure(folder: Path) -> list[Figure]:
    """Random chains; each answer is judged where the judge's own sum ends in half a minute."""
    found = tally(chains(), _PROBLEMS, Budget(4 << 30, machine_speed()))
    return [
        Figure(
            "random chains, tol 1e-1 to 1e-6: answers that keep tol",
            "all",
            f"{found.judged - len(found.wrong)} of {found.judged} judged ({found.accepted} "
            f"accepted, {found.drawn} drawn); largest error {found.worst:.2f} tol",
            not found.wrong,
        ),
        Figure(
            "random chains accepted, 4 GB",
            "≥ 90 %",
            f"{100 * found.accepted / found.drawn:.1f} %",
            found.accepted >= 0.9 * found.drawn,
        ),
        Figure(
            "refused chains whose refusal is true",
            "all",
            f"{found.refused - len(found.unreal)} of {found.refused}",
            not found.unreal,
        ),
    ]


@single_threaded
def chain_regret_figure(folder: Path) -> list[Figure]:
    """Every method that meets tol, timed beside the chosen one."""
    budget = Budget(4 << 30, machine_speed())
    choices = psf_choices(chains(_SEED + 1), budget, _TIMED_SECONDS)
    return choice_figures("chains", list(islice(choices, _TIMED)))


MEASUREMENTS = {"chains": chain_tolerance_figure, "chain-regret": chain_regret_figure}
