"""Which of several kernels gives the picture that is most like a natural one."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from optics.deconvolution.blind.search import Photograph
from optics.deconvolution.blind.statistics import gradients
from optics.deconvolution.measured import measured
from optics.deconvolution.total_variation import total_variation
from optics.progress import Progress

_RIM = 5
"""Pixels beyond half a kernel that the border is taken to tell on."""


def most_natural(photo: Photograph, kernels: Sequence[torch.Tensor], progress: Progress) -> int:
    """Which kernel it is by which the restored picture is the sparsest of edges: see sparsity()."""
    costs = []
    for number, kernel in enumerate(kernels):
        progress.report(number / len(kernels), f"judging kernel {number + 1}/{len(kernels)}")
        costs.append(sparsity(photo, kernel))
    return min(range(len(costs)), key=lambda number: costs[number])


def sparsity(photo: Photograph, kernel: torch.Tensor) -> float:
    """Mean length of the restored picture's gradients over their rms: high where blur has spread
    edges, and where a wrong kernel has made them ring (Krishnan, Tay and Fergus 2011, doi
    10.1109/CVPR.2011.5995521)."""
    seen = measured(photo.image, kernel, photo.noise or None, clipped=photo.known == 0)
    picture = total_variation(seen).image
    rim = min(kernel.shape[0] // 2 + _RIM, min(picture.shape) // 4)
    inside = gradients(picture[rim:-rim, rim:-rim])
    size = float(inside.square().mean().sqrt())
    return float(inside.abs().mean()) / size if size > 0 else 1.0
