"""Periodic continuation of a photograph beyond its border, as FFTs need it.

The scene beyond the frame is blurred into the photograph, but it isn't measured.
"""

from __future__ import annotations

import torch

from optics.plane import centred_pad


def extend_periodically(image: torch.Tensor, shape: tuple[int, int]) -> torch.Tensor:
    """Extend a photograph smoothly to the period `shape`.

    The picture is mirrored at each edge. Across the gap, the mirrored parts of two opposite edges
    are blended into each other by a raised cosine, so that opposite edges meet smoothly.
    """
    whole = centred_pad(image, shape)
    for dim in (-1, -2):
        _fill_gap(whole, image.shape[dim], dim)
    return whole


def _fill_gap(whole: torch.Tensor, n: int, dim: int) -> None:
    """Fill the samples around the n known ones in the middle, along one axis, in place."""
    length = whole.shape[dim]
    gap, first = length - n, length // 2 - n // 2
    if gap == 0:
        return
    step = torch.arange(gap)
    ramp = (0.5 * (1 + torch.cos(torch.pi * (step + 1) / (gap + 1)))).to(whole)
    ramp = ramp if dim == -1 else ramp[:, None]
    period = max(2 * n - 2, 1)
    beyond_end = whole.index_select(dim, first + _mirror(n + step, n, period))
    beyond_start = whole.index_select(dim, first + _mirror(step - gap, n, period))
    filling = torch.lerp(beyond_start, beyond_end, ramp)
    after = gap - first
    whole.narrow(dim, first + n, after).copy_(filling.narrow(dim, 0, after))
    whole.narrow(dim, 0, first).copy_(filling.narrow(dim, after, first))


def _mirror(index: torch.Tensor, n: int, period: int) -> torch.Tensor:
    """Mirror an index beyond the edge back into the n samples."""
    folded = index % period
    return torch.where(folded < n, folded, period - folded)
