"""How good a pattern or a video is, on a grid that speckle can't hide from."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from optics.metrics import efficiency, scaled_nrmse, speckle_contrast
from optics.retrieval.goal import RetrievalGoal


@dataclass(frozen=True)
class PatternQuality:
    """Figures of merit as optics.metrics defines them, of a PSF in its target's window.

    efficiency: share of all light where the target exceeds 2 % of its peak. contrast: speckle
    where it exceeds half its peak. nrmse: error of the shape, with the best scale.
    """

    efficiency: float
    contrast: float
    nrmse: float


def measure_quality(goal: RetrievalGoal, light: torch.Tensor) -> PatternQuality:
    """Of an intensity on the goal's plane, as a share of all light."""
    target = goal.target
    return PatternQuality(
        efficiency(light, target), speckle_contrast(light, target), scaled_nrmse(light, target)
    )
