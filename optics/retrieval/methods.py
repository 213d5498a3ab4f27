"""Every way from a target to a pattern or a video, by name, with what an iteration costs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch

from optics.accuracy import MachineSpeed
from optics.fourier.fft import fft_operations
from optics.retrieval.descent import Descent
from optics.retrieval.far_field import FarField
from optics.retrieval.frames import independent, joint, sequential
from optics.retrieval.gerchberg_saxton import (
    Constraint,
    iterate,
    mixed_region,
    over_compensated,
    replaced,
)
from optics.retrieval.goal import Goal
from optics.retrieval.job import Job
from optics.retrieval.published import published
from optics.retrieval.slow_crystal import responding, shown_ways
from optics.retrieval.spots import weighted
from optics.retrieval.starts import starting_field
from optics.retrieval.superpixel import Superpixels, coarsest

QUICK_ITERATIONS = 100
"""Of a quick method, where nothing else is asked for."""


_FREEDOM = 0.4
"""Of mixed regions: more takes too much light, less leaves too much speckle."""

_PASSES = 2.5
"""Time of a round trip to the far field and back over that of its FFTs."""

_MOTION = 2.6
"""Time of an iteration over one without the liquid crystal's motion."""

_WAY_BACK = 2.5
"""Time of a step of the descent over that of a round trip with all pixels."""


Solve = Callable[[Job], torch.Tensor]
"""To phases (frames, rows, columns), radians."""


@dataclass(frozen=True)
class Method:
    """A way from a target to frames.

    what: in a few words. least, most: the numbers of frames that it serves.
    round_trip: seconds of one iteration of one frame.
    """

    solve: Solve
    what: str
    least: int
    most: int
    round_trip: Callable[[Goal, MachineSpeed], float]

    def seconds(self, goal: Goal, frames: int, iterations: int, speed: MachineSpeed) -> float:
        """Predicted processor time."""
        lift = 0.5 * _all_pixels(goal, speed)
        return frames * (lift + iterations * self.round_trip(goal, speed))

    def iterations(self, goal: Goal, frames: int, seconds: float, speed: MachineSpeed) -> int:
        """How many fit; may be less than one."""
        rest = seconds - self.seconds(goal, frames, 0, speed)
        return int(rest / (frames * self.round_trip(goal, speed)))

    def serves(self, frames: int) -> bool:
        return self.least <= frames <= self.most


MOST_FRAMES = 3600
"""A minute at 60 Hz."""


def _trip(far_field: FarField, speed: MachineSpeed) -> float:
    each = fft_operations(far_field.length) / far_field.length
    return _PASSES * far_field.samples * each * speed.fft


def _superpixels(goal: Goal, speed: MachineSpeed) -> float:
    return _trip(coarsest(goal).far_field, speed)


def _all_pixels(goal: Goal, speed: MachineSpeed) -> float:
    return _trip(goal.far_field, speed)


def _moving(goal: Goal, speed: MachineSpeed) -> float:
    return _MOTION * _superpixels(goal, speed)


def _there_and_back(goal: Goal, speed: MachineSpeed) -> float:
    return _WAY_BACK * _all_pixels(goal, speed)


def _single(constraint: Callable[[torch.Tensor], Constraint], name: str) -> Solve:
    """One frame, by iterations with a constraint on the image."""

    def solve(job: Job) -> torch.Tensor:
        pixels = job.pixels
        field = starting_field(job.goal, pixels, job.start, job.generator)
        constrain = constraint(pixels.intensity)
        asked = iterate(pixels, field, constrain, job.iterations, job.progress, name)
        return pixels.pattern(asked)[None]

    return solve


def _several(way: Callable[[Superpixels, Job], torch.Tensor]) -> Solve:
    """Frames whose mean counts."""

    def solve(job: Job) -> torch.Tensor:
        pixels = job.pixels
        return pixels.pattern(way(pixels, job))

    return solve


def _weighted(job: Job) -> torch.Tensor:
    pixels = job.pixels
    return pixels.pattern(weighted(pixels, job.iterations, job.generator, job.progress))[None]


def _published(job: Job) -> torch.Tensor:
    """As many frames as are wanted, each from a random start of its own."""
    found = (published(job.goal, job.iterations, job.generator, part) for part in job.parts)
    return torch.stack(list(found))


def _responding(job: Job) -> torch.Tensor:
    pixels = job.pixels
    asked = responding(pixels, replace(job, progress=job.progress.part(0, 0.9)))
    return shown_ways(job.goal, pixels.pattern(asked))


def _descent(job: Job) -> torch.Tensor:
    """From what the quick method gives; the iterations are the descent's own."""
    quick = replace(job, iterations=converged(job.frames), progress=job.progress.part(0, 0.1))
    start = METHODS[quick_method(job.frames)].solve(quick)
    return Descent(job.goal).run(start, job.iterations, job.progress.part(0.1, 1))


def quick_method(frames: int) -> str:
    """What is on the front of quality against time until it has converged."""
    return "over-compensated" if frames == 1 else "joint"


def converged(frames: int) -> int:
    """Iterations after which the quick method hardly gains."""
    return 300 if frames == 1 else 100


METHODS: dict[str, Method] = {
    "published": Method(
        _published, "Gerchberg-Saxton as the thesis' program has it", 1, MOST_FRAMES, _all_pixels
    ),
    "gerchberg-saxton": Method(
        _single(replaced, "Gerchberg-Saxton"), "the same, corrected", 1, 1, _superpixels
    ),
    "mixed-region": Method(
        _single(lambda target: mixed_region(target, _FREEDOM), "mixed region"),
        "MRAF: freedom where the target is dark",
        1,
        1,
        _superpixels,
    ),
    "over-compensated": Method(
        _single(over_compensated, "over-compensated"),
        "errors are answered by their opposites",
        1,
        1,
        _superpixels,
    ),
    "weighted": Method(_weighted, "weighted Gerchberg-Saxton, for spots only", 1, 1, _superpixels),
    "independent": Method(
        _several(independent),
        "frames that know nothing of each other",
        1,
        MOST_FRAMES,
        _superpixels,
    ),
    "sequential": Method(
        _several(sequential), "each frame aims at what is left", 2, MOST_FRAMES, _superpixels
    ),
    "joint": Method(
        _several(joint), "all frames together, feedback on their mean", 2, MOST_FRAMES, _superpixels
    ),
    "responding": Method(
        _responding, "joint, for a liquid crystal that is slow", 2, MOST_FRAMES, _moving
    ),
    "descent": Method(
        _descent, "gradient descent through the real modulator", 1, MOST_FRAMES, _there_and_back
    ),
}
"""By name, in the order from the published one to the dearest."""
