"""What lies beyond the picture: it was blurred into it and nobody measured it."""

from __future__ import annotations

from collections.abc import Sequence

import scipy.fft
import torch

from optics.fourier import rfft2
from optics.plane import centred_pad, origin_to_corner


def padded_shape(image: Sequence[int], psf: Sequence[int]) -> tuple[int, int]:
    """A fast FFT size that holds the picture and half a PSF on every side."""
    rows, columns = (
        scipy.fft.next_fast_len(n + m, real=True) for n, m in zip(image, psf, strict=True)
    )
    return rows, columns


def transfer_function(psf: torch.Tensor, shape: tuple[int, int]) -> torch.Tensor:
    """The rfft2 of a PSF whose origin is at n // 2, padded to `shape`."""
    return rfft2(origin_to_corner(centred_pad(psf, shape)))


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


def require_psf(psf: torch.Tensor) -> None:
    """Raise ValueError for a PSF that no deconvolution can use."""
    if not torch.isfinite(psf).all():
        raise ValueError("psf has NaN or infinite values; measure or compute it again")
    if not float(psf.sum()) > 0:
        raise ValueError(f"psf sums to {float(psf.sum()):g}; it must send light somewhere")
