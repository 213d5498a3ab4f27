"""How good a pattern or a video is, on a grid that speckle can't hide from."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import torch

from optics.metrics import efficiency, shape_error, speckle_contrast
from optics.retrieval.goal import Goal
from optics.retrieval.grid import OVERSAMPLING


@dataclass(frozen=True)
class Quality:
    """Figures of merit as optics.metrics defines them, of a PSF in its target's window.

    efficiency: share of all light where the target exceeds 2 % of its peak. contrast: speckle
    where it exceeds half its peak. nrmse: error of the shape, with the best scale.
    """

    efficiency: float
    contrast: float
    nrmse: float


def judge(goal: Goal, light: torch.Tensor) -> Quality:
    """Of an intensity on the goal's plane, as a share of all light."""
    target = goal.target
    return Quality(
        efficiency(light, target), speckle_contrast(light, target), shape_error(light, target)
    )


def mean_light(
    goal: Goal, phases: Iterable[torch.Tensor], oversampling: int = OVERSAMPLING
) -> torch.Tensor:
    """The mean PSF of frames (rows, columns), share of all light a sample of the window.

    oversampling: of the grid, in units of the pupil's Nyquist rate; the window stays.
    """
    far_field = goal.finer(oversampling)
    total, count = torch.zeros(far_field.window, dtype=torch.float64), 0
    for phase in phases:
        field = torch.polar(goal.amplitude, phase.to(torch.float32))
        total += far_field.intensity(field)
        count += 1
    factor = oversampling // OVERSAMPLING
    return total / (count * goal.power * factor**2)
