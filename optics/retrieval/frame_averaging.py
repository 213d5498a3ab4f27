"""Compute videos whose frames have a mean PSF with the target's shape.

The exposure averages the frames. The thesis averages independent frames (§3.3.2), whose speckle
falls with the square root of their number, down to a floor that averaging doesn't remove. Its
outlook (§3.6) proposes that each frame aims at the light that the others lack; that is
`sequential_frames`. `joint_frames` computes all frames together.
"""

from __future__ import annotations

from collections.abc import Iterable

import torch

from optics.retrieval.far_field import field_intensity
from optics.retrieval.gerchberg_saxton import (
    amplitude_constraint,
    iterate_constraint,
    over_compensated_constraint,
)
from optics.retrieval.superpixel import RetrievalJob, Superpixels, random_start, smooth_start

_GAIN = 0.5  # exponent of the correction of the mean in each iteration. Chosen, as those below.

_UNCORRECTED = 3  # iterations before the mean is corrected for the first time

_MOST_CHANGE = 10.0  # largest factor of the correction in one iteration

# Share of the brightest sample that replaces a smaller mean, to avoid division by zero.
_DARK_SHARE = 1e-6

_FAINT_SHARE = 1e-3  # share of a sample's target that replaces a smaller mean


def independent_frames(pixels: Superpixels, job: RetrievalJob) -> torch.Tensor:
    """Compute frames one by one, each from its own random start.

    Returns the fields on the window, (frames, rows, columns).
    """
    fields = []
    for number, part in enumerate(job.frame_progress, start=1):
        start = pixels.panel_field(random_start(pixels, job.generator))
        constrain = amplitude_constraint(pixels.target_intensity)
        fields.append(
            iterate_constraint(pixels, start, constrain, job.iterations, part, f"frame {number}:")
        )
    return torch.stack(fields)


def sequential_frames(pixels: Superpixels, job: RetrievalJob) -> torch.Tensor:
    """Compute frames one by one, each for the light that earlier frames lack.

    Frame n aims at n T minus the sum of the light of the frames before it, where T is the target.
    """
    target = pixels.target_intensity
    total, fields = torch.zeros_like(target), []
    for number, part in enumerate(job.frame_progress, start=1):
        missing = (number * target - total).clamp(min=0)
        missing = torch.where(missing.sum() > 0, missing, target)
        wanted = missing * (target.sum() / missing.sum())
        start = pixels.panel_field(smooth_start(pixels, job.generator))
        constrain = over_compensated_constraint(wanted)
        field = iterate_constraint(
            pixels, start, constrain, job.iterations, part, f"frame {number}:"
        )
        fields.append(field)
        given = field_intensity(pixels.far_field.round_trip(field, pixels.uneven_amplitude))
        # The scale excludes light beside the target, because a larger request can't replace it.
        total = total + given * (target.sum() / given[target > 0].sum())
    return torch.stack(fields)


def joint_frames(pixels: Superpixels, job: RetrievalJob) -> torch.Tensor:
    """Compute all frames together, so that their mean intensity becomes the target.

    Each frame keeps its share of the light at a sample. The mean is set to a request that is
    corrected by the error of the last mean.
    """
    target = pixels.target_intensity
    constrain, wanted, iterations = amplitude_constraint(target), target, job.iterations
    starts = (smooth_start(pixels, job.generator) for _ in range(job.frames))
    fields = [pixels.far_field.forward(pixels.panel_field(start)) for start in starts]
    for iteration in range(iterations):
        job.progress.report(iteration / iterations, f"joint frames {iteration + 1}/{iterations}")
        if iteration < _UNCORRECTED:
            asked = [constrain(field) for field in fields]
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
    """Return the next intensity to request, after `request` gave `mean`.

    Only the shape of `target` matters: a lack of light everywhere doesn't change the request.
    """
    lit = target > 0
    scale = mean[lit].sum() / target[lit].sum()
    missing = scale * target
    given = torch.maximum(mean, _FAINT_SHARE * missing)
    change = torch.where(given > 0, missing / given, 1.0).clamp(1 / _MOST_CHANGE, _MOST_CHANGE)
    asked = request * torch.where(lit, change, 1.0) ** _GAIN
    return asked * (target.sum() / asked.sum())


def scale_to_mean(
    fields: Iterable[torch.Tensor], mean: torch.Tensor, request: torch.Tensor
) -> list[torch.Tensor]:
    """Scale frames' fields to change their mean intensity from `mean` to `request`."""
    factor = torch.sqrt(request / mean.clamp(min=_DARK_SHARE * float(request.max())))
    return [field * factor for field in fields]


def mean_intensity(fields: Iterable[torch.Tensor]) -> torch.Tensor:
    """Return the mean of the frames' intensities."""
    return torch.stack([field_intensity(field) for field in fields]).mean(0)
