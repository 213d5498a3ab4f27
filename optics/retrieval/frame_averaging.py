"""Frames whose mean has the target's shape: a phase video that the exposure averages.

The thesis averages frames that know nothing of each other (§3.3.2), whose speckle falls with
the square root of their number, to a floor that averaging never removes. Its outlook (§3.6)
proposes to aim each frame at what the others left; that is `sequential_frames`. `joint_frames`
computes all frames together.
"""

from __future__ import annotations

from collections.abc import Iterable

import torch

from optics.retrieval.far_field import unit_modulus
from optics.retrieval.gerchberg_saxton import (
    amplitude_constraint,
    iterate_constraint,
    over_compensated_constraint,
)
from optics.retrieval.job import RetrievalJob
from optics.retrieval.start_phases import random_start, smooth_start
from optics.retrieval.superpixel import Superpixels

_GAIN = 0.5
"""Power of the correction of the mean in each iteration."""

_FIRST = 3
"""Iterations until the mean is worth correcting."""

_STEP = 10.0
"""The correction's largest factor in one iteration."""

_DARK = 1e-6
"""Share of the brightest sample below which the mean counts as this: nothing can be divided by."""

_FAINT = 1e-3
"""Share of a sample's target below which its mean counts as this."""


def independent_frames(pixels: Superpixels, job: RetrievalJob) -> torch.Tensor:
    """Fields on the window (frames, rows, columns), each from a random start of its own."""
    fields = []
    for number, part in enumerate(job.frame_progress, start=1):
        start = pixels.panel_field(random_start(pixels, job.generator))
        constrain = amplitude_constraint(pixels.target_intensity)
        fields.append(
            iterate_constraint(pixels, start, constrain, job.iterations, part, f"frame {number}:")
        )
    return torch.stack(fields)


def sequential_frames(pixels: Superpixels, job: RetrievalJob) -> torch.Tensor:
    """Each frame aims at what the frames before it left: n T minus the sum of their light."""
    target = pixels.target_intensity
    total, fields = torch.zeros_like(target), []
    for number, part in enumerate(job.frame_progress, start=1):
        missing = (number * target - total).clamp(min=0)
        missing = torch.where(missing.sum() > 0, missing, target)
        wanted = missing * (target.sum() / missing.sum())
        start = pixels.panel_field(smooth_start(pixels.goal, pixels, job.generator))
        constrain = over_compensated_constraint(wanted)
        field = iterate_constraint(
            pixels, start, constrain, job.iterations, part, f"frame {number}:"
        )
        fields.append(field)
        given = field_intensity(pixels.far_field.round_trip(field, pixels.uneven_amplitude))
        # What falls beside the target can't be made up for by asking for more.
        total = total + given * (target.sum() / given[target > 0].sum())
    return torch.stack(fields)


def joint_frames(pixels: Superpixels, job: RetrievalJob) -> torch.Tensor:
    """All frames together: each keeps its share of the light at a sample, and their mean is
    what is asked for, corrected by what it came out as."""
    target = pixels.target_intensity
    amplitude = torch.sqrt(target)
    fields, wanted = [], target
    for _ in range(job.frames):
        start = pixels.panel_field(smooth_start(pixels.goal, pixels, job.generator))
        fields.append(pixels.far_field.forward(start))
    iterations = job.iterations
    for iteration in range(iterations):
        job.progress.report(iteration / iterations, f"joint frames {iteration + 1}/{iterations}")
        if iteration < _FIRST:
            asked = [unit_modulus(field) * amplitude for field in fields]
        else:
            mean = mean_intensity(fields)
            wanted = correct_request(wanted, target, mean)
            asked = scale_to_mean(fields, mean, wanted)
        if iteration < iterations - 1:
            fields = [
                pixels.far_field.round_trip(field, pixels.uneven_amplitude) for field in asked
            ]
    return torch.stack(asked)


def correct_request(
    request: torch.Tensor, target: torch.Tensor, mean: torch.Tensor
) -> torch.Tensor:
    """What to ask for next, when asking for `request` gave `mean` and `target` is the goal.

    Only the shape counts: light that is missing everywhere isn't asked for.
    """
    lit = target > 0
    scale = mean[lit].sum() / target[lit].sum()
    missing = scale * target
    given = torch.maximum(mean, _FAINT * missing)
    change = torch.where(given > 0, missing / given, 1.0).clamp(1 / _STEP, _STEP)
    change = torch.where(lit, change, 1.0)
    asked = request * change**_GAIN
    return asked * (target.sum() / asked.sum())


def scale_to_mean(
    fields: Iterable[torch.Tensor], mean: torch.Tensor, request: torch.Tensor
) -> list[torch.Tensor]:
    """Fields whose mean intensity is `mean`, each with its share of `request` instead."""
    factor = torch.sqrt(request / mean.clamp(min=_DARK * float(request.max())))
    return [field * factor for field in fields]


def mean_intensity(fields: Iterable[torch.Tensor]) -> torch.Tensor:
    """The mean intensity of frames."""
    return torch.stack([field_intensity(field) for field in fields]).mean(0)


def field_intensity(field: torch.Tensor) -> torch.Tensor:
    """The intensity of a field."""
    return field.real**2 + field.imag**2
