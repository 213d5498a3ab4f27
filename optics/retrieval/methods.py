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
    weighted_spots_field,
)
from optics.retrieval.goal import RetrievalGoal
from optics.retrieval.slow_crystal import shortest_panel_phases, slow_crystal_frames
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
    rows, columns = (max(1, n * side // goal.far_field_samples) for n in goal.plane.shape)
    far_field = FarField(goal.camera.panel.shape, side, (rows, columns))
    amplitude = torch.sqrt(_subsampled_target(goal, far_field.window))
    left_over = _residual_lens_phasor(far_field.window)
    phase = torch.rand(goal.camera.panel.shape, generator=generator) * 6 * math.pi
    field = torch.polar(torch.ones_like(phase), phase)
    for iteration in range(iterations):
        progress.report(iteration / iterations, f"as published {iteration + 1}/{iterations}")
        asked = unit_modulus(far_field.forward(field)) * amplitude * left_over
        field = unit_modulus(far_field.adjoint(asked))
    return torch.angle(field)


def _subsampled_target(goal: RetrievalGoal, window: tuple[int, int]) -> torch.Tensor:
    """Take the target's nearest sample for each of the published program's coarser grid."""
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


MOST_FRAMES = 3600
"""Largest number of frames of a retrieved video, one minute at 60 Hz."""

Solver = Callable[[RetrievalJob], torch.Tensor]
"""Type of a function that solves a retrieval job: it returns phases in radians, (frames, rows,
columns)."""


@dataclass(frozen=True)
class RetrievalMethod:
    """A way to find phases, with its solver and its cost.

    description: a few words for users.
    trips: time of one iteration of one frame, relative to a round trip between panel and window.
    on_superpixels: whether that round trip is one of superpixels, or of all pixels.
    """

    solve: Solver
    description: str
    min_frames: int = 1
    max_frames: int = MOST_FRAMES
    trips: float = 1.0
    on_superpixels: bool = True

    def seconds(
        self, goal: RetrievalGoal, frames: int, iterations: int, speed: MachineSpeed
    ) -> float:
        """Predict the processor time of all frames and iterations, in seconds."""
        lift = 0.5 * _round_trip_seconds(goal.far_field, speed)
        return frames * (lift + iterations * self._iteration_seconds(goal, speed))

    def iterations(
        self, goal: RetrievalGoal, frames: int, seconds: float, speed: MachineSpeed
    ) -> int:
        """Return how many iterations fit into `seconds`, which may be less than one."""
        rest = seconds - self.seconds(goal, frames, 0, speed)
        return int(rest / (frames * self._iteration_seconds(goal, speed)))

    def _iteration_seconds(self, goal: RetrievalGoal, speed: MachineSpeed) -> float:
        far_field = coarsest_superpixels(goal).far_field if self.on_superpixels else goal.far_field
        return self.trips * _round_trip_seconds(far_field, speed)

    def serves(self, frames: int) -> bool:
        return self.min_frames <= frames <= self.max_frames


def _round_trip_seconds(far_field: FarField, speed: MachineSpeed) -> float:
    """Predict the seconds of a round trip between panel and window, from its FFTs."""
    each = fft_operations(far_field.length) / far_field.length
    # A round trip takes 2.5 times as long as its FFTs.
    return 2.5 * far_field.samples * each * speed.fft


def _solve_published_program(job: RetrievalJob) -> torch.Tensor:
    """Compute every frame by the published program, each from its own random start."""
    found = (
        published_program_pattern(job.goal, job.iterations, job.generator, part)
        for part in job.frame_progress
    )
    return torch.stack(list(found))


def _solver(way: Callable[[Superpixels, RetrievalJob], torch.Tensor]) -> Solver:
    """Return a solver from a way to find fields on the window, (frames, rows, columns)."""

    def solve(job: RetrievalJob) -> torch.Tensor:
        pixels = coarsest_superpixels(job.goal)
        return pixels.pixel_phases(way(pixels, job))

    return solve


def _single_frame_solver(constraint: Callable[[torch.Tensor], Constraint], name: str) -> Solver:
    """Return a solver for one frame, which iterates with a constraint on the window's field."""

    def iterate(pixels: Superpixels, job: RetrievalJob) -> torch.Tensor:
        field = starting_field(pixels, job.start, job.generator)
        constrain = constraint(pixels.target_intensity)
        asked = iterate_constraint(pixels, field, constrain, job.iterations, job.progress, name)
        return asked[None]

    return _solver(iterate)


def _weighted_spots(pixels: Superpixels, job: RetrievalJob) -> torch.Tensor:
    return weighted_spots_field(pixels, job.iterations, job.generator, job.progress)[None]


def _solve_slow_crystal(job: RetrievalJob) -> torch.Tensor:
    phases = _solver(slow_crystal_frames)(replace(job, progress=job.progress.part(0, 0.9)))
    return shortest_panel_phases(job.goal, phases)


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
        on_superpixels=False,
    ),
    "gerchberg-saxton": RetrievalMethod(
        _single_frame_solver(amplitude_constraint, "Gerchberg-Saxton"),
        "Gerchberg-Saxton, corrected",
        max_frames=1,
    ),
    "mixed-region": RetrievalMethod(
        # More freedom takes too much light, and less leaves too much speckle.
        _single_frame_solver(lambda target: mixed_region_constraint(target, 0.4), "mixed region"),
        "MRAF: light is free where the target is dark",
        max_frames=1,
    ),
    "over-compensated": RetrievalMethod(
        _single_frame_solver(over_compensated_constraint, "over-compensated"),
        "the target is corrected by more than the error",
        max_frames=1,
    ),
    "weighted": RetrievalMethod(
        _solver(_weighted_spots),
        "weighted Gerchberg-Saxton, for spots only",
        max_frames=1,
    ),
    "independent": RetrievalMethod(
        _solver(independent_frames),
        "frames that are retrieved independently",
    ),
    "sequential": RetrievalMethod(
        _solver(sequential_frames),
        "each frame makes up for the errors of those before",
        min_frames=2,
    ),
    "joint": RetrievalMethod(
        _solver(joint_frames),
        "all frames together, with feedback on their mean",
        min_frames=2,
    ),
    "responding": RetrievalMethod(
        _solve_slow_crystal,
        "joint, through the response of a slow liquid crystal",
        min_frames=2,
        # The liquid crystal's motion is computed as well.
        trips=2.6,
    ),
    "descent": RetrievalMethod(
        _solve_descent,
        "gradient descent through the model of the modulator",
        # A step is differentiated.
        trips=2.5,
        on_superpixels=False,
    ),
}
"""The methods by name, from the published one to the most expensive one."""
