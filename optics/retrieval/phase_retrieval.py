"""From a target to a pattern or a video, by the method that serves best in the time given."""

from __future__ import annotations

import time
from dataclasses import dataclass

import torch

from optics.accuracy import IterationOption, MachineSpeed, best_within, select_methods
from optics.camera import Camera
from optics.plane import Plane
from optics.progress import Progress
from optics.retrieval.goal import RetrievalGoal
from optics.retrieval.job import RetrievalJob
from optics.retrieval.methods import (
    METHODS,
    MOST_FRAMES,
    QUICK_ITERATIONS,
    iterations_to_converge,
    quick_method,
)
from optics.retrieval.quality import PatternQuality, measure_quality
from optics.retrieval.slow_crystal import displayed_psf, usable_orders
from optics.retrieval.start_phases import require_start
from optics.slm.lut import require_orders
from optics.threads import single_threaded
from optics.validation import accepts_numpy, require_count, require_positive

_WORTH = 5
"""Steps of the descent from which it gains more than the quick method would."""


@dataclass(frozen=True)
class RetrievalResult:
    """Frames that give a target's shape.

    phases: (frames, rows, columns), radians, float32. orders: waves of the panel's range that
    they use: show them with phase_to_grey(panel, phases, wavelength, orders). quality: of their
    mean PSF, rounded to the panel's levels, and with the liquid crystal's motion if there are
    several and the panel's response_time isn't zero; on a grid twice finer than Nyquist.
    cpu_seconds: spent on the frames, the judgement left out.
    """

    phases: torch.Tensor
    orders: int
    method: str
    iterations: int
    quality: PatternQuality
    cpu_seconds: float


@accepts_numpy
@single_threaded
def retrieve(
    camera: Camera,
    target: torch.Tensor,
    plane: Plane,
    wavelength: float,
    *,
    frames: int = 1,
    budget: float | None = None,
    iterations: int | None = None,
    method: str | None = None,
    start: str = "smooth",
    generator: torch.Generator,
    progress: Progress | None = None,
    speed: MachineSpeed | None = None,
) -> RetrievalResult:
    """Phases whose PSF, or whose frames' mean PSF, has the target's shape.

    target: intensity on `plane` (rows, columns), from design_plane(camera, wavelength, ...);
    any scale, zero beyond. frames: of a video. budget: processor seconds that may be spent, as
    predicted; iterations: instead of it. method: one of METHODS; if None, the quick one, and
    gradient descent through the modulator where the budget has time left for it. start: of
    single frames, one of STARTS. generator: all chance comes from it. speed: of the
    machine, by which a budget becomes a number of iterations.

    There is no right answer, and no tolerance: the quality reached is measured. Raises
    ValueError for a target that no PSF can have, a method that doesn't serve here, or a budget
    in which no iteration fits.
    """
    progress, speed = progress or Progress(), speed or MachineSpeed()
    _require(frames, budget, iterations, method)
    require_start(start)
    goal = RetrievalGoal(camera, target, plane, wavelength)
    # A panel that can't show a pattern is refused before one is computed.
    require_orders(camera.panel, wavelength, 1)
    slow = frames > 1 and camera.panel.response_time > 0
    quick = "responding" if slow else quick_method(frames)
    if budget is None:
        method, count = method or quick, QUICK_ITERATIONS if iterations is None else iterations
    else:
        best = _best_option(
            goal, frames, budget, method or quick, slow or method is not None, speed
        )
        method, count = best.method, best.count
    job = RetrievalJob(goal, frames, count, generator, progress.part(0, 0.9), start)
    started = time.process_time()
    phases = METHODS[method].solve(job)
    spent = time.process_time() - started
    progress.report(0.9, "measuring the quality")
    orders = usable_orders(camera.panel, wavelength) if method == "responding" else 1
    quality = measure_quality(goal, displayed_psf(goal, phases, orders))
    progress.report(1.0, f"{method}, {count} iterations")
    return RetrievalResult(phases, orders, method, count, quality, spent)


def _require(frames: int, budget: float | None, iterations: int | None, method: str | None) -> None:
    """Raise ValueError for what can't be asked for, whatever the target."""
    if not 1 <= frames <= MOST_FRAMES:
        raise ValueError(
            f"frames is {frames}; a pattern has one, and a video {MOST_FRAMES} at most"
        )
    if budget is not None and iterations is not None:
        raise ValueError("budget and iterations are both given; give one of them")
    if budget is not None:
        require_positive("budget", budget, "s")
    if iterations is not None:
        require_count("iterations", iterations)
    select_methods(METHODS, method)
    serving = [name for name, one in METHODS.items() if one.serves(frames)]
    select_methods(serving, method, _count_phrase(frames, "frame"))


def _best_option(
    goal: RetrievalGoal, frames: int, budget: float, method: str, alone: bool, speed: MachineSpeed
) -> IterationOption:
    """A method, or the descent where it gains more, with as many iterations as fit.

    alone: whether no descent is looked at.
    """
    settings = [_affordable_option(goal, frames, budget, method, 1, speed)]
    if not alone:
        settings.append(_affordable_option(goal, frames, budget, "descent", _WORTH, speed))
    return best_within(budget, settings)


def _affordable_option(
    goal: RetrievalGoal, frames: int, budget: float, method: str, least: int, speed: MachineSpeed
) -> IterationOption:
    """Of a method, as many iterations as a budget has time for, but no fewer than `least`, which
    is also what a method gains."""
    before, way = _startup_seconds(goal, frames, method, speed), METHODS[method]
    count = max(way.iterations(goal, frames, budget - before, speed), least)
    seconds = before + way.seconds(goal, frames, count, speed)
    words = f"{_count_phrase(least, 'iteration')} of {method} with {_count_phrase(frames, 'frame')}"
    return IterationOption(method, count, seconds, least, words)


def _startup_seconds(goal: RetrievalGoal, frames: int, method: str, speed: MachineSpeed) -> float:
    """Seconds until a method's first iteration: the descent starts from a good solution."""
    if method != "descent":
        return 0.0
    return METHODS[quick_method(frames)].seconds(
        goal, frames, iterations_to_converge(frames), speed
    )


def _count_phrase(number: int, thing: str) -> str:
    return f"{number} {thing}{'' if number == 1 else 's'}"
