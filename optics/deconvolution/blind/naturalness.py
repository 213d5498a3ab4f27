"""Which of several kernels gives the picture that is most like a natural one."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch

from optics.deconvolution.blind.gradient_statistics import gradients
from optics.deconvolution.blind.kernel_search import NormalisedPhotograph
from optics.deconvolution.observation_builder import build_observation
from optics.deconvolution.total_variation import total_variation
from optics.progress import Progress

_BORDER_MARGIN = 5
"""Pixels beyond half a kernel that the border is taken to tell on."""


def rank_by_naturalness(
    photo: NormalisedPhotograph, kernels: Sequence[torch.Tensor], progress: Progress
) -> list[int]:
    """Which kernels restore the least strange pictures, the best first: see unnaturalness()."""
    costs = []
    for number, kernel in enumerate(kernels):
        progress.report(number / len(kernels), f"judging kernel {number + 1}/{len(kernels)}")
        costs.append(unnaturalness(photo, kernel))
    return sorted(range(len(costs)), key=lambda number: costs[number])


def unnaturalness(photo: NormalisedPhotograph, kernel: torch.Tensor) -> float:
    """Mean length of the restored picture's gradients over their rms: high where blur has spread
    edges, and where a wrong kernel has made them ring (Krishnan, Tay and Fergus 2011, doi
    10.1109/CVPR.2011.5995521). Times the factor by which what the restoration leaves of the
    photograph isn't the noise: a wrong kernel is made up for by detail that isn't there."""
    seen = build_observation(photo.image, kernel, photo.noise or None, clipped=photo.valid == 0)
    answer = total_variation(seen)
    rim = min(kernel.shape[0] // 2 + _BORDER_MARGIN, min(answer.image.shape) // 4)
    inside = gradients(answer.image[rim:-rim, rim:-rim])
    size = float(inside.square().mean().sqrt())
    if size == 0:
        return math.inf
    left = max(answer.residual, 1e-3)
    return float(inside.abs().mean()) / size * max(left, 1 / left)
