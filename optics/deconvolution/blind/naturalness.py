"""Comparison of blur kernels by how natural the pictures are that they restore."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch

from optics.deconvolution.blind.gradient_statistics import gradients
from optics.deconvolution.blind.kernel_search import NormalisedPhotograph
from optics.deconvolution.observation_builder import build_observation
from optics.deconvolution.total_variation import total_variation
from optics.progress import Progress


def rank_by_naturalness(
    photo: NormalisedPhotograph, kernels: Sequence[torch.Tensor], progress: Progress
) -> list[int]:
    """Rank blur kernels by the unnaturalness() of the pictures that deconvolution gives with them.

    The indices are returned with the best kernel first.
    """
    costs = []
    for number, kernel in enumerate(kernels):
        progress.report(number / len(kernels), f"judging kernel {number + 1}/{len(kernels)}")
        costs.append(unnaturalness(photo, kernel))
    return sorted(range(len(costs)), key=lambda number: costs[number])


def unnaturalness(photo: NormalisedPhotograph, kernel: torch.Tensor) -> float:
    """Measure how unnatural a photograph looks after deconvolution with a blur kernel.

    The measure is the mean length of the picture's gradients over their rms. It is high for blurred
    edges, and for ringing by a wrong kernel (Krishnan, Tay and Fergus 2011, doi
    10.1109/CVPR.2011.5995521). It is multiplied by the factor by which the residual differs from
    the noise, since a restoration with a wrong kernel adds false detail.
    """
    seen = build_observation(photo.image, kernel, photo.noise or None, clipped=photo.valid == 0)
    answer = total_variation(seen)
    # The unknown border affects a rim of half a kernel and 5 pixels, which is left out.
    rim = min(kernel.shape[0] // 2 + 5, min(answer.image.shape) // 4)
    inside = gradients(answer.image[rim:-rim, rim:-rim])
    size = float(inside.square().mean().sqrt())
    if size == 0:
        return math.inf
    left = max(answer.residual, 1e-3)
    return float(inside.abs().mean()) / size * max(left, 1 / left)
