"""Frames whose mean has the target's shape: a phase video that the exposure averages.

The thesis averages frames that know nothing of each other (§3.3.2), whose speckle falls with
the square root of their number, to a floor that averaging never removes. Its outlook (§3.6)
proposes to aim each frame at what the others left; that is `sequential`. `joint` computes all
frames together.
"""

from __future__ import annotations

from collections.abc import Iterable

import torch

from optics.retrieval.far_field import unit
from optics.retrieval.gerchberg_saxton import iterate, over_compensated, replaced
from optics.retrieval.job import Job
from optics.retrieval.starts import random, smooth
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


def independent(pixels: Superpixels, job: Job) -> torch.Tensor:
    """Fields on the window (frames, rows, columns), each from a random start of its own."""
    fields = []
    for number, part in enumerate(job.parts, start=1):
        start = pixels.lit(random(pixels, job.generator))
        constrain = replaced(pixels.intensity)
        fields.append(iterate(pixels, start, constrain, job.iterations, part, f"frame {number}:"))
    return torch.stack(fields)


def sequential(pixels: Superpixels, job: Job) -> torch.Tensor:
    """Each frame aims at what the frames before it left: n T minus the sum of their light."""
    target = pixels.intensity
    total, fields = torch.zeros_like(target), []
    for number, part in enumerate(job.parts, start=1):
        missing = (number * target - total).clamp(min=0)
        missing = torch.where(missing.sum() > 0, missing, target)
        wanted = missing * (target.sum() / missing.sum())
        start = pixels.lit(smooth(pixels.goal, pixels, job.generator))
        constrain = over_compensated(wanted)
        field = iterate(pixels, start, constrain, job.iterations, part, f"frame {number}:")
        fields.append(field)
        given = light(pixels.far_field.bounce(field, pixels.uneven))
        # What falls beside the target can't be made up for by asking for more.
        total = total + given * (target.sum() / given[target > 0].sum())
    return torch.stack(fields)


def joint(pixels: Superpixels, job: Job) -> torch.Tensor:
    """All frames together: each keeps its share of the light at a sample, and their mean is
    what is asked for, corrected by what it came out as."""
    target = pixels.intensity
    amplitude = torch.sqrt(target)
    fields, wanted = [], target
    for _ in range(job.frames):
        start = pixels.lit(smooth(pixels.goal, pixels, job.generator))
        fields.append(pixels.far_field.forward(start))
    iterations = job.iterations
    for iteration in range(iterations):
        job.progress.report(iteration / iterations, f"joint frames {iteration + 1}/{iterations}")
        if iteration < _FIRST:
            asked = [unit(field) * amplitude for field in fields]
        else:
            mean = mean_light(fields)
            wanted = corrected(wanted, target, mean)
            asked = scaled(fields, mean, wanted)
        if iteration < iterations - 1:
            fields = [pixels.far_field.bounce(field, pixels.uneven) for field in asked]
    return torch.stack(asked)


def corrected(wanted: torch.Tensor, target: torch.Tensor, mean: torch.Tensor) -> torch.Tensor:
    """What to ask for next, when asking for `wanted` gave `mean` and `target` is the goal.

    Only the shape counts: light that is missing everywhere isn't asked for.
    """
    lit = target > 0
    scale = mean[lit].sum() / target[lit].sum()
    missing = scale * target
    given = torch.maximum(mean, _FAINT * missing)
    change = torch.where(given > 0, missing / given, 1.0).clamp(1 / _STEP, _STEP)
    change = torch.where(lit, change, 1.0)
    asked = wanted * change**_GAIN
    return asked * (target.sum() / asked.sum())


def scaled(
    fields: Iterable[torch.Tensor], mean: torch.Tensor, wanted: torch.Tensor
) -> list[torch.Tensor]:
    """Fields whose mean intensity is `mean`, each with its share of `wanted` instead."""
    factor = torch.sqrt(wanted / mean.clamp(min=_DARK * float(wanted.max())))
    return [field * factor for field in fields]


def mean_light(fields: Iterable[torch.Tensor]) -> torch.Tensor:
    """The mean intensity of frames."""
    return torch.stack([light(field) for field in fields]).mean(0)


def light(field: torch.Tensor) -> torch.Tensor:
    """The intensity of a field."""
    return field.real**2 + field.imag**2
