"""What lies beyond the picture: it was blurred into it and nobody measured it."""

from __future__ import annotations

import torch


def continued(image: torch.Tensor, shape: tuple[int, int]) -> torch.Tensor:
    """The picture continued to `shape` so that its opposite edges meet smoothly.

    Beyond the edge the picture is mirrored, and the mirrored parts of two opposite edges
    are blended into each other across the gap by a raised cosine.
    """
    return _continued_axis(_continued_axis(image, shape[1], -1), shape[0], -2)


def _continued_axis(image: torch.Tensor, length: int, dim: int) -> torch.Tensor:
    n = image.shape[dim]
    gap = length - n
    after = gap - (length // 2 - n // 2)
    if gap == 0:
        return image
    step = torch.arange(gap)
    ramp = (0.5 * (1 + torch.cos(torch.pi * (step + 1) / (gap + 1)))).to(image)
    ramp = ramp if dim == -1 else ramp[:, None]
    period = max(2 * n - 2, 1)
    beyond_end = image.index_select(dim, _mirror(n + step, n, period))
    beyond_start = image.index_select(dim, _mirror(step - gap, n, period))
    filling = beyond_end * ramp + beyond_start * (1 - ramp)
    parts = filling.narrow(dim, after, gap - after), image, filling.narrow(dim, 0, after)
    return torch.cat(parts, dim=dim)


def _mirror(index: torch.Tensor, n: int, period: int) -> torch.Tensor:
    folded = index % period
    return torch.where(folded < n, folded, period - folded)
