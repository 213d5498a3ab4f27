"""Find a pattern or a video for a target PSF by the best method for the time, and judge it."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import torch

from optics.accuracy import IterationOption, MachineSpeed, best_within, select_methods
from optics.camera import Camera
from optics.camera.pupil import open_area, with_stop_shadow_on_panel
from optics.metrics import efficiency, scaled_nrmse, speckle_contrast
from optics.plane import Plane
from optics.progress import Progress
from optics.retrieval.goal import RetrievalGoal
from optics.retrieval.methods import METHODS, MOST_FRAMES, iterations_to_converge, quick_method
from optics.retrieval.slow_crystal import displayed_psf, usable_orders
from optics.retrieval.superpixel import RetrievalJob, require_start
from optics.slm.lut import require_orders
from optics.threads import single_threaded
from optics.validation import accepts_numpy, require_count, require_positive


@dataclass(frozen=True)
class PatternQuality:
    """Figures of merit of a PSF in its target's window, as `optics.metrics` defines them.

    Parameters
    ----------
    efficiency : float
        Share of all light that leaves the pupil and falls where the target exceeds 2 % of its peak,
        0 to 1. Light that the panel's gaps send into other orders is missing, and light that the
        panel can't modulate counts where it falls.
    steered_share : float
        The same of the modulated light of one order, without gaps and unmodulated light.
    contrast, nrmse : float
        Of the modulated light: speckle contrast where the target exceeds half of its peak, and
        normalised root-mean-square error of the shape, with the best scale.
    """

    efficiency: float
    steered_share: float
    contrast: float
    nrmse: float


def measure_quality(goal: RetrievalGoal, light: torch.Tensor) -> PatternQuality:
    """Measure how well a PSF on the goal's plane matches the target.

    light: PSF of the modulated light, as shares of one order's light.
    """
    target = goal.target
    return PatternQuality(
        efficiency(_light_with_gaps(goal, light), target),
        efficiency(light, target),
        speckle_contrast(light, target),
        scaled_nrmse(light, target),
    )


def _light_with_gaps(goal: RetrievalGoal, light: torch.Tensor) -> torch.Tensor:
    """Convert a PSF to shares of all light, with the panel's gaps and unmodulated light.

    A pixel of fill factor F sends the share F sinc²(m sqrt F) sinc²(n sqrt F) of its light to the
    place m by n orders off the axis, and unmodulated light adds in intensity (thesis §5.6). Where
    the stop's shadow limits the light, shares are of what panel and stop would pass in one plane,
    as those of a PSFOperator.
    """
    camera, panel = goal.camera, goal.camera.panel
    order = goal.plane.pitch[0] * goal.far_field_samples
    y, x = (torch.sinc(u / order * math.sqrt(panel.fill_factor)) ** 2 for u in goal.plane.mesh())
    straight = goal.far_field.intensity(goal.amplitude.to(torch.complex64)).to(torch.float64)
    share, passing = panel.unmodulated, open_area(with_stop_shadow_on_panel(camera))
    shown = (1 - share) * light + share * straight / goal.power
    return shown * (panel.fill_factor * y * x * passing / open_area(camera))


@dataclass(frozen=True)
class RetrievalResult:
    """Phases of frames whose mean PSF has a target's shape, with their quality.

    Parameters
    ----------
    phases : torch.Tensor, (frames, rows, columns), float32
        Phases in radians.
    orders : int
        Waves of the panel's range that the phases use. Show them with
        ``phase_to_grey(panel, phases, wavelength, orders)``.
    method, iterations : str and int
        Name of the method that found them, one of `METHODS`, and number of its iterations.
    quality : PatternQuality
        Of the mean PSF, with phases rounded to the panel's levels, on a grid twice finer than
        Nyquist. The liquid crystal's motion counts where there are several frames and the panel's
        response_time isn't zero.
    cpu_seconds : float
        Processor seconds spent on the frames, without the measurement of their quality.
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
    """Find phases whose PSF, or whose frames' mean PSF, has the target's shape.

    There is no unique right answer, and so no tolerance: the quality reached is measured.

    Parameters
    ----------
    camera : Camera
        Camera whose panel shows the pattern.
    target : torch.Tensor or numpy.ndarray, (rows, columns)
        Intensity on `plane`, on any scale, nowhere negative; zero is meant beyond the plane.
    plane : Plane
        Samples of the target in the focal plane, from ``design_plane(camera, wavelength, ...)``.
    wavelength : float
        Metres.
    frames : int, default 1
        1 for a pattern; more for a video, 3600 at most.
    budget : float, optional
        Processor seconds that may be spent, as predicted for the machine's speed.
    iterations : int, optional
        Number of iterations, 1 or more, instead of a budget. 100 if both are None.
    method : str, optional
        One of `METHODS`. If None, the quick method for that number of frames; and gradient descent
        through the modulator where a budget leaves time for it.
    start : {"smooth", "quadratic", "random"}, default "smooth"
        Phases that single frames start from, one of `STARTS`.
    generator : torch.Generator
        Source of all random numbers.
    progress : Progress, optional
        Receives reports, and can cancel the work.
    speed : MachineSpeed, optional
        That of the machine, by which a budget becomes a number of iterations.

    Returns
    -------
    RetrievalResult
        The phases, how they were found, and their quality.

    Raises
    ------
    ValueError
        If no PSF can have the target, the plane is on another grid, the method doesn't serve here,
        no iteration fits in the budget, or `budget` and `iterations` are both given.
    """
    progress, speed = progress or Progress(), speed or MachineSpeed()
    _require_valid(frames, budget, iterations, method)
    require_start(start)
    goal = RetrievalGoal(camera, target, plane, wavelength)
    # A panel whose range is too short is refused before any pattern is computed.
    require_orders(camera.panel, wavelength, 1)
    slow = frames > 1 and camera.panel.response_time > 0
    quick = "responding" if slow else quick_method(frames)
    if budget is None:
        method, count = method or quick, 100 if iterations is None else iterations
    else:
        # Where a budget leaves time for it, the descent is better than the quick method: it gains
        # more from 5 steps on.
        least = {method or quick: 1} if slow or method is not None else {quick: 1, "descent": 5}
        options = [
            _affordable_option(goal, frames, budget, name, count, speed)
            for name, count in least.items()
        ]
        best = best_within(budget, options)
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


def _require_valid(
    frames: int, budget: float | None, iterations: int | None, method: str | None
) -> None:
    """Raise ValueError for arguments that are invalid for any target."""
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


def _affordable_option(
    goal: RetrievalGoal, frames: int, budget: float, method: str, least: int, speed: MachineSpeed
) -> IterationOption:
    """Return a method with the iterations that a budget allows, as an option.

    The option has at least `least` iterations. `least` also ranks the option's gain.
    """
    before, way = 0.0, METHODS[method]
    if method == "descent":
        # It starts from phases that the quick method retrieves.
        quick = METHODS[quick_method(frames)]
        before = quick.seconds(goal, frames, iterations_to_converge(frames), speed)
    count = max(way.iterations(goal, frames, budget - before, speed), least)
    seconds = before + way.seconds(goal, frames, count, speed)
    words = f"{_count_phrase(least, 'iteration')} of {method} with {_count_phrase(frames, 'frame')}"
    return IterationOption(method, count, seconds, least, words)


def _count_phrase(number: int, thing: str) -> str:
    return f"{number} {thing}{'' if number == 1 else 's'}"
