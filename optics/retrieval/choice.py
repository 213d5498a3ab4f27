"""From a target to a pattern or a video, by the method that serves best in the time given."""

from __future__ import annotations

import time
from dataclasses import dataclass

import torch

from optics.accuracy import MachineSpeed, Setting, best_within, named
from optics.camera import Camera
from optics.edge import require_count, require_positive, tensors_inside
from optics.plane import Plane
from optics.progress import Progress
from optics.retrieval.goal import Goal
from optics.retrieval.job import Job
from optics.retrieval.judging import Quality, judge
from optics.retrieval.methods import METHODS, MOST_FRAMES, QUICK_ITERATIONS, converged, quick_method
from optics.retrieval.slow_crystal import orders_of, shown_light
from optics.retrieval.starts import require_start
from optics.slm.lut import require_orders
from optics.threads import single_threaded

_WORTH = 5
"""Steps of the descent from which it gains more than the quick method would."""


@dataclass(frozen=True)
class Retrieved:
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
    quality: Quality
    cpu_seconds: float


@tensors_inside
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
) -> Retrieved:
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
    goal = Goal(camera, target, plane, wavelength)
    # A panel that can't show a pattern is refused before one is computed.
    require_orders(camera.panel, wavelength, 1)
    slow = frames > 1 and camera.panel.response_time > 0
    quick = "responding" if slow else quick_method(frames)
    if budget is None:
        method, count = method or quick, QUICK_ITERATIONS if iterations is None else iterations
    else:
        best = _best(goal, frames, budget, method or quick, slow or method is not None, speed)
        method, count = best.method, best.count
    job = Job(goal, frames, count, generator, progress.part(0, 0.9), start)
    started = time.process_time()
    phases = METHODS[method].solve(job)
    spent = time.process_time() - started
    progress.report(0.9, "measuring the quality")
    orders = orders_of(camera.panel, wavelength) if method == "responding" else 1
    quality = judge(goal, shown_light(goal, phases, orders))
    progress.report(1.0, f"{method}, {count} iterations")
    return Retrieved(phases, orders, method, count, quality, spent)


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
    named(METHODS, method)
    serving = [name for name, one in METHODS.items() if one.serves(frames)]
    named(serving, method, _counted(frames, "frame"))


def _best(
    goal: Goal, frames: int, budget: float, method: str, alone: bool, speed: MachineSpeed
) -> Setting:
    """A method, or the descent where it gains more, with as many iterations as fit.

    alone: whether no descent is looked at.
    """
    settings = [_fitting(goal, frames, budget, method, 1, speed)]
    if not alone:
        settings.append(_fitting(goal, frames, budget, "descent", _WORTH, speed))
    return best_within(budget, settings)


def _fitting(
    goal: Goal, frames: int, budget: float, method: str, least: int, speed: MachineSpeed
) -> Setting:
    """Of a method, as many iterations as a budget has time for, but no fewer than `least`, which
    is also what a method gains."""
    before, way = _before(goal, frames, method, speed), METHODS[method]
    count = max(way.iterations(goal, frames, budget - before, speed), least)
    seconds = before + way.seconds(goal, frames, count, speed)
    words = f"{_counted(least, 'iteration')} of {method} with {_counted(frames, 'frame')}"
    return Setting(method, count, seconds, least, words)


def _before(goal: Goal, frames: int, method: str, speed: MachineSpeed) -> float:
    """Seconds until a method's first iteration: the descent starts from a good solution."""
    if method != "descent":
        return 0.0
    return METHODS[quick_method(frames)].seconds(goal, frames, converged(frames), speed)


def _counted(number: int, thing: str) -> str:
    return f"{number} {thing}{'' if number == 1 else 's'}"
