"""How good a pattern or a video is, on a grid that speckle can't hide from."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from optics.metrics import efficiency, shape_error, speckle_contrast
from optics.retrieval.goal import Goal


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
