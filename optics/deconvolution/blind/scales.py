"""Scales of the blur kernel search: shrinking photographs, and enlarging and centring kernels."""

from __future__ import annotations

import math

import torch

STEP = math.sqrt(2)
"""Ratio between one scale of the kernel search and the next."""


def scale_factors(size: int) -> list[float]:
    """Return the factors by which blind deconvolution shrinks a photograph, from coarse to 1.

    A kernel of `size` has at least 3 pixels at the coarsest scale.
    """
    count = max(0, math.floor(math.log(size / 3) / math.log(STEP)))
    return [STEP**number for number in range(count, -1, -1)]


def next_odd(size: float) -> int:
    """Round the size of blind deconvolution's blur kernel up to an odd number, 3 or more."""
    whole = math.ceil(size - 1e-9)
    return max(3, whole + 1 - whole % 2)


def downsample(image: torch.Tensor, factor: float) -> torch.Tensor:
    """Shrink a photograph without aliasing, for blind deconvolution at a coarser scale.

    The photograph is (rows, columns).
    """
    if factor == 1:
        return image
    rows, columns = (round(n / factor) for n in image.shape)
    return torch.nn.functional.interpolate(
        image[None, None], (rows, columns), mode="bilinear", antialias=True, align_corners=False
    )[0, 0]


def enlarge_kernel(kernel: torch.Tensor, factor: float, size: int) -> torch.Tensor:
    """Enlarge a blur kernel from a coarser to a finer scale of blind deconvolution.

    The origin stays at n // 2. The result is (size, size) with a sum of 1.
    """
    old = kernel.shape[-1]
    at = (torch.arange(size, dtype=kernel.dtype) - size // 2) / factor + old // 2
    share = torch.clamp(1 - (at[:, None] - torch.arange(old, dtype=kernel.dtype)).abs(), min=0)
    larger = share @ kernel @ share.T
    total = float(larger.sum())
    return larger / total if total > 0 else point_kernel(size).to(kernel)


def point_kernel(size: int) -> torch.Tensor:
    """Return blind deconvolution's kernel without blur: (size, size), all light at n // 2."""
    point = torch.zeros(size, size)
    point[size // 2, size // 2] = 1
    return point


def centre_kernel(kernel: torch.Tensor, size: int) -> torch.Tensor:
    """Move a blindly estimated blur kernel by whole pixels into the middle of (size, size).

    The result has a sum of 1. See centred_window_start().
    """
    cut = cut_window(kernel, centred_window_start(kernel, size), size)
    return cut / cut.sum()


def centred_window_start(kernel: torch.Tensor, size: int) -> tuple[int, int]:
    """Find the first row and column of the window that centres blind deconvolution's kernel.

    The window is (size, size), and may extend beyond the kernel. Among the windows that hold the
    most light, up to a small share, the one is chosen whose centre n // 2 is nearest to the
    kernel's centroid.
    """
    rows, columns = (
        _best_window_start(torch.nn.functional.pad(kernel.sum(1 - dim), (size, size)), size) - size
        for dim in (0, 1)
    )
    return rows, columns


def cut_window(kernel: torch.Tensor, first: tuple[int, int], size: int) -> torch.Tensor:
    """Cut a (size, size) window out of blind deconvolution's blur kernel, padded with zeros.

    `first` is the window's first row and column, which may lie up to `size` pixels outside the
    kernel.
    """
    padded = torch.nn.functional.pad(kernel, (size, size, size, size))
    y, x = first[0] + size, first[1] + size
    return padded[y : y + size, x : x + size]


def _best_window_start(profile: torch.Tensor, size: int) -> int:
    """Find where the window of `size` starts that centres blind deconvolution's kernel on an axis.

    `profile` is the kernel's sum over the other axis.
    """
    inside = torch.nn.functional.pad(profile.to(torch.float64).cumsum(0), (1, 0))
    held = inside[size:] - inside[:-size]
    whole = float(inside[-1])
    centroid = float((profile * torch.arange(profile.numel())).sum()) / whole
    # A window may lose up to 0.2 % more of the light than the best one to be centred better.
    good = (held >= float(held.max()) - 2e-3 * whole).nonzero().ravel().tolist()
    return int(min(good, key=lambda first: abs(first + size // 2 - centroid)))
