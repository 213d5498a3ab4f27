"""What lies beyond the picture: it was blurred into it and nobody measured it."""

from __future__ import annotations

import torch


def continued(image: torch.Tensor, shape: tuple[int, int]) -> torch.Tensor:
    """The picture continued to `shape` so that its opposite edges meet smoothly.

    Beyond the edge the picture is mirrored, and the mirrored parts of two opposite edges
    are blended into each other across the gap by a raised cosine.
    """
    return _continued_axis(_continued_axis(image, shape[1]).mT, shape[0]).mT


def _continued_axis(image: torch.Tensor, length: int) -> torch.Tensor:
    n = image.shape[-1]
    gap = length - n
    before = length // 2 - n // 2
    if gap == 0:
        return image
    step = torch.arange(gap)
    ramp = (0.5 * (1 + torch.cos(torch.pi * (step + 1) / (gap + 1)))).to(image)
    period = max(2 * n - 2, 1)
    after_edge = _mirror(n + step, n, period)
    before_edge = _mirror(step - gap, n, period)
    filling = image[..., after_edge] * ramp + image[..., before_edge] * (1 - ramp)
    whole = torch.cat([image, filling], dim=-1)
    return torch.roll(whole, before, dims=-1)


def _mirror(index: torch.Tensor, n: int, period: int) -> torch.Tensor:
    folded = index % period
    return torch.where(folded < n, folded, period - folded)
