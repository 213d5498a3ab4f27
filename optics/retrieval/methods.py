"""Every way from a target to a pattern or a video, by name, with what an iteration costs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch

from optics.accuracy import MachineSpeed
from optics.fourier.fft import fft_operations
from optics.retrieval.descent import GradientDescent
from optics.retrieval.far_field import FarField
from optics.retrieval.frame_averaging import independent_frames, joint_frames, sequential_frames
from optics.retrieval.gerchberg_saxton import (
    Constraint,
    amplitude_constraint,
    iterate_constraint,
    mixed_region_constraint,
    over_compensated_constraint,
)
from optics.retrieval.goal import RetrievalGoal
from optics.retrieval.job import RetrievalJob
from optics.retrieval.published_program import published_program_pattern
from optics.retrieval.slow_crystal import shortest_panel_phases, slow_crystal_frames
from optics.retrieval.spots import weighted_spots_field
from optics.retrieval.start_phases import starting_field
from optics.retrieval.superpixel import Superpixels, coarsest_superpixels

QUICK_ITERATIONS = 100
"""Of a quick method, where nothing else is asked for."""


_FREEDOM = 0.4
"""Of mixed regions: more takes too much light, less leaves too much speckle."""

_PASSES = 2.5
"""Time of a round trip to the far field and back over that of its FFTs."""

_MOTION = 2.6
"""Time of an iteration over one without the liquid crystal's motion."""

_GRADIENT_COST_FACTOR = 2.5
"""Time of a step of the descent over that of a round trip with all pixels."""


Solver = Callable[[RetrievalJob], torch.Tensor]
"""To phases (frames, rows, columns), radians."""


@dataclass(frozen=True)
class RetrievalMethod:
    """A way from a target to frames.

    description: in a few words. min_frames, max_frames: the numbers of frames that it serves.
    round_trip: seconds of one iteration of one frame.
    """

    solve: Solver
    description: str
    min_frames: int
    max_frames: int
    round_trip: Callable[[RetrievalGoal, MachineSpeed], float]

    def seconds(
        self, goal: RetrievalGoal, frames: int, iterations: int, speed: MachineSpeed
    ) -> float:
        """Predicted processor time."""
        lift = 0.5 * _full_trip_seconds(goal, speed)
        return frames * (lift + iterations * self.round_trip(goal, speed))

    def iterations(
        self, goal: RetrievalGoal, frames: int, seconds: float, speed: MachineSpeed
    ) -> int:
        """How many fit; may be less than one."""
        rest = seconds - self.seconds(goal, frames, 0, speed)
        return int(rest / (frames * self.round_trip(goal, speed)))

    def serves(self, frames: int) -> bool:
        return self.min_frames <= frames <= self.max_frames


MOST_FRAMES = 3600
"""A minute at 60 Hz."""


def _round_trip_seconds(far_field: FarField, speed: MachineSpeed) -> float:
    each = fft_operations(far_field.length) / far_field.length
    return _PASSES * far_field.samples * each * speed.fft


def _superpixel_trip_seconds(goal: RetrievalGoal, speed: MachineSpeed) -> float:
    return _round_trip_seconds(coarsest_superpixels(goal).far_field, speed)


def _full_trip_seconds(goal: RetrievalGoal, speed: MachineSpeed) -> float:
    return _round_trip_seconds(goal.far_field, speed)


def _slow_crystal_trip_seconds(goal: RetrievalGoal, speed: MachineSpeed) -> float:
    return _MOTION * _superpixel_trip_seconds(goal, speed)


def _descent_step_seconds(goal: RetrievalGoal, speed: MachineSpeed) -> float:
    return _GRADIENT_COST_FACTOR * _full_trip_seconds(goal, speed)


def _single_frame_solver(constraint: Callable[[torch.Tensor], Constraint], name: str) -> Solver:
    """One frame, by iterations with a constraint on the image."""

    def solve(job: RetrievalJob) -> torch.Tensor:
        pixels = job.superpixels
        field = starting_field(job.goal, pixels, job.start, job.generator)
        constrain = constraint(pixels.target_intensity)
        asked = iterate_constraint(pixels, field, constrain, job.iterations, job.progress, name)
        return pixels.pixel_phases(asked)[None]

    return solve


def _multi_frame_solver(way: Callable[[Superpixels, RetrievalJob], torch.Tensor]) -> Solver:
    """Frames whose mean counts."""

    def solve(job: RetrievalJob) -> torch.Tensor:
        pixels = job.superpixels
        return pixels.pixel_phases(way(pixels, job))

    return solve


def _solve_weighted_spots(job: RetrievalJob) -> torch.Tensor:
    pixels = job.superpixels
    return pixels.pixel_phases(
        weighted_spots_field(pixels, job.iterations, job.generator, job.progress)
    )[None]


def _solve_published_program(job: RetrievalJob) -> torch.Tensor:
    """As many frames as are wanted, each from a random start of its own."""
    found = (
        published_program_pattern(job.goal, job.iterations, job.generator, part)
        for part in job.frame_progress
    )
    return torch.stack(list(found))


def _solve_slow_crystal(job: RetrievalJob) -> torch.Tensor:
    pixels = job.superpixels
    asked = slow_crystal_frames(pixels, replace(job, progress=job.progress.part(0, 0.9)))
    return shortest_panel_phases(job.goal, pixels.pixel_phases(asked))


def _solve_descent(job: RetrievalJob) -> torch.Tensor:
    """From what the quick method gives; the iterations are the descent's own."""
    quick = replace(
        job, iterations=iterations_to_converge(job.frames), progress=job.progress.part(0, 0.1)
    )
    start = METHODS[quick_method(job.frames)].solve(quick)
    return GradientDescent(job.goal).run(start, job.iterations, job.progress.part(0.1, 1))


def quick_method(frames: int) -> str:
    """What is on the front of quality against time until it has converged."""
    return "over-compensated" if frames == 1 else "joint"


def iterations_to_converge(frames: int) -> int:
    """Iterations after which the quick method hardly gains."""
    return 300 if frames == 1 else 100


METHODS: dict[str, RetrievalMethod] = {
    "published": RetrievalMethod(
        _solve_published_program,
        "Gerchberg-Saxton as the thesis' program has it",
        1,
        MOST_FRAMES,
        _full_trip_seconds,
    ),
    "gerchberg-saxton": RetrievalMethod(
        _single_frame_solver(amplitude_constraint, "Gerchberg-Saxton"),
        "the same, corrected",
        1,
        1,
        _superpixel_trip_seconds,
    ),
    "mixed-region": RetrievalMethod(
        _single_frame_solver(
            lambda target: mixed_region_constraint(target, _FREEDOM), "mixed region"
        ),
        "MRAF: freedom where the target is dark",
        1,
        1,
        _superpixel_trip_seconds,
    ),
    "over-compensated": RetrievalMethod(
        _single_frame_solver(over_compensated_constraint, "over-compensated"),
        "errors are answered by their opposites",
        1,
        1,
        _superpixel_trip_seconds,
    ),
    "weighted": RetrievalMethod(
        _solve_weighted_spots,
        "weighted Gerchberg-Saxton, for spots only",
        1,
        1,
        _superpixel_trip_seconds,
    ),
    "independent": RetrievalMethod(
        _multi_frame_solver(independent_frames),
        "frames that know nothing of each other",
        1,
        MOST_FRAMES,
        _superpixel_trip_seconds,
    ),
    "sequential": RetrievalMethod(
        _multi_frame_solver(sequential_frames),
        "each frame aims at what is left",
        2,
        MOST_FRAMES,
        _superpixel_trip_seconds,
    ),
    "joint": RetrievalMethod(
        _multi_frame_solver(joint_frames),
        "all frames together, feedback on their mean",
        2,
        MOST_FRAMES,
        _superpixel_trip_seconds,
    ),
    "responding": RetrievalMethod(
        _solve_slow_crystal,
        "joint, for a liquid crystal that is slow",
        2,
        MOST_FRAMES,
        _slow_crystal_trip_seconds,
    ),
    "descent": RetrievalMethod(
        _solve_descent,
        "gradient descent through the real modulator",
        1,
        MOST_FRAMES,
        _descent_step_seconds,
    ),
}
"""By name, in the order from the published one to the dearest."""
