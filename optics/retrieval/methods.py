"""List the methods by name, with the cost of their iterations.

Gerchberg-Saxton as the thesis' authors published it is one, for comparison.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import torch

from optics.accuracy import MachineSpeed
from optics.fourier.fft import fft_operations
from optics.progress import Progress
from optics.retrieval.descent import GradientDescent
from optics.retrieval.far_field import FarField, unit_modulus
from optics.retrieval.frame_averaging import independent_frames, joint_frames, sequential_frames
from optics.retrieval.gerchberg_saxton import (
    Constraint,
    amplitude_constraint,
    iterate_constraint,
    mixed_region_constraint,
    over_compensated_constraint,
)
from optics.retrieval.goal import RetrievalGoal
from optics.retrieval.slow_crystal import shortest_panel_phases, slow_crystal_frames
from optics.retrieval.spots import weighted_spots_field
from optics.retrieval.superpixel import (
    RetrievalJob,
    Superpixels,
    coarsest_superpixels,
    starting_field,
)


def published_program_pattern(
    goal: RetrievalGoal, iterations: int, generator: torch.Generator, progress: Progress
) -> torch.Tensor:
    """Compute a phase pattern (rows, columns) by the steps of the published program.

    Its far field has as many samples as the panel's longer side, so it misses the speckle between
    them. The program multiplies the image by the lens' quadratic phase exp(i k r² / 2f), but
    divides it by exp(i k r²), and uses the pupil's pitch for the image's. The remaining phase is
    added to the image in every iteration. That is harmless for a ring around the axis, but not for
    a spiral. Raises ValueError for a target that is dark on the program's grid.
    """
    side = max(goal.camera.panel.shape)
    far_field = FarField(goal.camera.panel.shape, side, _window(goal, side))
    amplitude = torch.sqrt(_subsampled_target(goal, far_field.window))
    left_over = _residual_lens_phasor(far_field.window)
    phase = torch.rand(goal.camera.panel.shape, generator=generator) * 6 * math.pi
    field = torch.polar(torch.ones_like(phase), phase)
    for iteration in range(iterations):
        progress.report(iteration / iterations, f"as published {iteration + 1}/{iterations}")
        asked = unit_modulus(far_field.forward(field)) * amplitude * left_over
        field = unit_modulus(far_field.adjoint(asked))
    return torch.angle(field)


def _window(goal: RetrievalGoal, side: int) -> tuple[int, int]:
    """Return the (rows, columns) of the published program's window on its grid."""
    rows, columns = (max(1, n * side // goal.far_field_samples) for n in goal.plane.shape)
    return rows, columns


def _subsampled_target(goal: RetrievalGoal, window: tuple[int, int]) -> torch.Tensor:
    """Sample the target on the published program's coarser grid.

    Each sample takes the value of the nearest sample of the target.
    """
    picked = []
    ratio = goal.far_field_samples / max(goal.camera.panel.shape)
    for n, m in zip(goal.plane.shape, window, strict=True):
        index = torch.round((torch.arange(m) - m // 2) * ratio).long() + n // 2
        picked.append(index.clamp(0, n - 1))
    target = goal.target.to(torch.float32)[picked[0][:, None], picked[1]]
    if not target.any():
        raise ValueError(
            "target is dark on every second sample, and the published program sees no others; "
            "draw it wider than a sample, or choose another method"
        )
    return target


def _residual_lens_phasor(window: tuple[int, int]) -> torch.Tensor:
    """Return the lens phasor that remains in the published program, exp(i k r² (1 / 2f - 1)).

    Its phase is computed in double precision and reduced to one wave.
    """
    # The published program uses these lengths in metres for every camera.
    pitch, wavelength, focal_length = 8e-6, 550e-9, 0.15
    y, x = ((torch.arange(n, dtype=torch.float64) - n // 2) * pitch for n in window)
    r2 = y[:, None] ** 2 + x**2
    turns = r2 / wavelength * (1 / (2 * focal_length) - 1)
    angle = 2 * math.pi * (turns - torch.round(turns))
    return torch.polar(torch.ones_like(angle), angle).to(torch.complex64)


Solver = Callable[[RetrievalJob], torch.Tensor]
"""Type of a function that solves a retrieval job: it returns phases (frames, rows, columns).

The phases are in radians.
"""


@dataclass(frozen=True)
class RetrievalMethod:
    """A way to find phases, with its solver and its cost.

    solve: the solver. description: a few words for users. min_frames, max_frames: the range of
    frame numbers that the method supports. round_trip: function that predicts the processor time in
    seconds of one iteration of one frame.
    """

    solve: Solver
    description: str
    min_frames: int
    max_frames: int
    round_trip: Callable[[RetrievalGoal, MachineSpeed], float]

    def seconds(
        self, goal: RetrievalGoal, frames: int, iterations: int, speed: MachineSpeed
    ) -> float:
        """Predict the processor time of all frames and iterations, in seconds."""
        lift = 0.5 * _full_trip_seconds(goal, speed)
        return frames * (lift + iterations * self.round_trip(goal, speed))

    def iterations(
        self, goal: RetrievalGoal, frames: int, seconds: float, speed: MachineSpeed
    ) -> int:
        """Return how many iterations fit into `seconds`, which may be less than one."""
        rest = seconds - self.seconds(goal, frames, 0, speed)
        return int(rest / (frames * self.round_trip(goal, speed)))

    def serves(self, frames: int) -> bool:
        return self.min_frames <= frames <= self.max_frames


MOST_FRAMES = 3600
"""Largest number of frames of a retrieved video, one minute at 60 Hz."""


def _round_trip_seconds(far_field: FarField, speed: MachineSpeed) -> float:
    """Predict the seconds of a round trip between panel and window, from its FFTs."""
    each = fft_operations(far_field.length) / far_field.length
    # A round trip takes 2.5 times as long as its FFTs.
    return 2.5 * far_field.samples * each * speed.fft


def _superpixel_trip_seconds(goal: RetrievalGoal, speed: MachineSpeed) -> float:
    return _round_trip_seconds(coarsest_superpixels(goal).far_field, speed)


def _full_trip_seconds(goal: RetrievalGoal, speed: MachineSpeed) -> float:
    return _round_trip_seconds(goal.far_field, speed)


def _slow_crystal_trip_seconds(goal: RetrievalGoal, speed: MachineSpeed) -> float:
    # An iteration with the liquid crystal's motion takes 2.6 times as long as one without it.
    return 2.6 * _superpixel_trip_seconds(goal, speed)


def _descent_step_seconds(goal: RetrievalGoal, speed: MachineSpeed) -> float:
    # A step of the descent takes 2.5 times as long as a round trip with all pixels.
    return 2.5 * _full_trip_seconds(goal, speed)


def _single_frame_solver(constraint: Callable[[torch.Tensor], Constraint], name: str) -> Solver:
    """Return a solver for one frame, which iterates with a constraint on the window's field."""

    def solve(job: RetrievalJob) -> torch.Tensor:
        pixels = job.superpixels
        field = starting_field(job.goal, pixels, job.start, job.generator)
        constrain = constraint(pixels.target_intensity)
        asked = iterate_constraint(pixels, field, constrain, job.iterations, job.progress, name)
        return pixels.pixel_phases(asked)[None]

    return solve


def _multi_frame_solver(way: Callable[[Superpixels, RetrievalJob], torch.Tensor]) -> Solver:
    """Return a solver for several frames whose mean PSF has the target's shape."""

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
    """Compute every frame by the published program, each from its own random start."""
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
    """Improve the quick method's phases by gradient descent, in `job.iterations` steps."""
    quick = replace(
        job, iterations=iterations_to_converge(job.frames), progress=job.progress.part(0, 0.1)
    )
    start = METHODS[quick_method(job.frames)].solve(quick)
    return GradientDescent(job.goal).run(start, job.iterations, job.progress.part(0.1, 1))


def quick_method(frames: int) -> str:
    """Return the name of the method with the best quality for little time."""
    return "over-compensated" if frames == 1 else "joint"


def iterations_to_converge(frames: int) -> int:
    """Return the number of iterations after which the quick method hardly improves."""
    return 300 if frames == 1 else 100


METHODS: dict[str, RetrievalMethod] = {
    "published": RetrievalMethod(
        _solve_published_program,
        "Gerchberg-Saxton as in the thesis' program",
        1,
        MOST_FRAMES,
        _full_trip_seconds,
    ),
    "gerchberg-saxton": RetrievalMethod(
        _single_frame_solver(amplitude_constraint, "Gerchberg-Saxton"),
        "Gerchberg-Saxton, corrected",
        1,
        1,
        _superpixel_trip_seconds,
    ),
    "mixed-region": RetrievalMethod(
        _single_frame_solver(
            # More freedom takes too much light, and less leaves too much speckle.
            lambda target: mixed_region_constraint(target, 0.4),
            "mixed region",
        ),
        "MRAF: light is free where the target is dark",
        1,
        1,
        _superpixel_trip_seconds,
    ),
    "over-compensated": RetrievalMethod(
        _single_frame_solver(over_compensated_constraint, "over-compensated"),
        "the target is corrected by more than the error",
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
        "frames that are retrieved independently",
        1,
        MOST_FRAMES,
        _superpixel_trip_seconds,
    ),
    "sequential": RetrievalMethod(
        _multi_frame_solver(sequential_frames),
        "each frame makes up for the errors of those before",
        2,
        MOST_FRAMES,
        _superpixel_trip_seconds,
    ),
    "joint": RetrievalMethod(
        _multi_frame_solver(joint_frames),
        "all frames together, with feedback on their mean",
        2,
        MOST_FRAMES,
        _superpixel_trip_seconds,
    ),
    "responding": RetrievalMethod(
        _solve_slow_crystal,
        "joint, through the response of a slow liquid crystal",
        2,
        MOST_FRAMES,
        _slow_crystal_trip_seconds,
    ),
    "descent": RetrievalMethod(
        _solve_descent,
        "gradient descent through the model of the modulator",
        1,
        MOST_FRAMES,
        _descent_step_seconds,
    ),
}
"""The methods by name, from the published one to the most expensive one."""
