"""From coarse to fine: photographs shrunk, kernels enlarged, and kernels put into the middle."""

from __future__ import annotations

import math

import torch

STEP = math.sqrt(2)
"""From one scale to the next."""

_COARSEST = 3
"""Pixels of the kernel at the coarsest scale, at least."""

_MAX_LOST_LIGHT = 2e-3
"""Share of a kernel's light that may fall off so that the rest is in the middle."""


def scale_factors(size: int) -> list[float]:
    """By which a photograph is shrunk, the coarsest first, 1 last."""
    count = max(0, math.floor(math.log(size / _COARSEST) / math.log(STEP)))
    return [STEP**number for number in range(count, -1, -1)]


def next_odd(size: float) -> int:
    """The next whole odd number, 3 or more."""
    whole = math.ceil(size - 1e-9)
    return max(3, whole + 1 - whole % 2)


def downsample(image: torch.Tensor, factor: float) -> torch.Tensor:
    """Of (rows, columns), without aliasing."""
    if factor == 1:
        return image
    rows, columns = (round(n / factor) for n in image.shape)
    return torch.nn.functional.interpolate(
        image[None, None], (rows, columns), mode="bilinear", antialias=True, align_corners=False
    )[0, 0]


def enlarge_kernel(kernel: torch.Tensor, factor: float, size: int) -> torch.Tensor:
    """Enlarged by a factor about its origin n // 2, onto (size, size), with a sum of 1."""
    old = kernel.shape[-1]
    at = (torch.arange(size, dtype=kernel.dtype) - size // 2) / factor + old // 2
    share = torch.clamp(1 - (at[:, None] - torch.arange(old, dtype=kernel.dtype)).abs(), min=0)
    larger = share @ kernel @ share.T
    total = float(larger.sum())
    return larger / total if total > 0 else point_kernel(size).to(kernel)


def point_kernel(size: int) -> torch.Tensor:
    """All light in the origin n // 2."""
    point = torch.zeros(size, size)
    point[size // 2, size // 2] = 1
    return point


def centre_kernel(kernel: torch.Tensor, size: int) -> torch.Tensor:
    """Moved by whole pixels into (size, size), with a sum of 1: see centred_window_start()."""
    cut = cut_window(kernel, centred_window_start(kernel, size), size)
    return cut / cut.sum()


def centred_window_start(kernel: torch.Tensor, size: int) -> tuple[int, int]:
    """First row and column of a window of (size, size), which may reach out of the kernel: nothing
    of it is lost that can be kept, and its centroid is as near to n // 2 as that allows."""
    rows, columns = (
        _best_window_start(torch.nn.functional.pad(kernel.sum(1 - dim), (size, size)), size) - size
        for dim in (0, 1)
    )
    return rows, columns


def cut_window(kernel: torch.Tensor, first: tuple[int, int], size: int) -> torch.Tensor:
    """(size, size) from a row and a column on, which may lie up to `size` outside; 0 there."""
    padded = torch.nn.functional.pad(kernel, (size, size, size, size))
    y, x = first[0] + size, first[1] + size
    return padded[y : y + size, x : x + size]


def _best_window_start(profile: torch.Tensor, size: int) -> int:
    """Of the window of `size` that is best."""
    inside = torch.nn.functional.pad(profile.to(torch.float64).cumsum(0), (1, 0))
    held = inside[size:] - inside[:-size]
    whole = float(inside[-1])
    centroid = float((profile * torch.arange(profile.numel())).sum()) / whole
    good = (held >= float(held.max()) - _MAX_LOST_LIGHT * whole).nonzero().ravel().tolist()
    return int(min(good, key=lambda first: abs(first + size // 2 - centroid)))
