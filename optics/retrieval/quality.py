"""Measure the quality of a retrieved pattern or video on a grid that resolves speckle."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from optics.metrics import efficiency, scaled_nrmse, speckle_contrast
from optics.retrieval.goal import RetrievalGoal


@dataclass(frozen=True)
class PatternQuality:
    """Figures of merit of a PSF in its target's window, as `optics.metrics` defines them.

    Parameters
    ----------
    efficiency : float
        Share of all light that falls where the target exceeds 2 % of its peak, 0 to 1.
    contrast : float
        Speckle contrast where the target exceeds half of its peak.
    nrmse : float
        Normalised root-mean-square error of the shape, with the best scale.
    """

    efficiency: float
    contrast: float
    nrmse: float


def measure_quality(goal: RetrievalGoal, light: torch.Tensor) -> PatternQuality:
    """Measure the quality of a retrieved phase's PSF on the goal's plane.

    `light` is the PSF, as shares of all light.
    """
    target = goal.target
    return PatternQuality(
        efficiency(light, target), speckle_contrast(light, target), scaled_nrmse(light, target)
    )
