"""Bring PSFs from fine pixels to detector pixels, and to the transfer functions of a period."""

from __future__ import annotations

import torch

from optics.fourier import rfft2
from optics.plane import origin_to_corner
from optics.threads import in_full_precision
from optics.validation import require_count


@in_full_precision
def bin_psf(psf: torch.Tensor, binning: int) -> torch.Tensor:
    """Compute the PSF on detector pixels that are squares of finer pixels.

    The scene is constant over a detector pixel, and the image's mean over it is captured. Together
    they weigh the finer PSF by a triangle along each axis, sampled once a detector pixel.

    Parameters
    ----------
    psf : torch.Tensor, (rows, columns)
        PSF on the finer pixels, origin at n // 2.
    binning : int
        Finer pixels along a side of a detector pixel.

    Returns
    -------
    torch.Tensor, (rows, columns)
        PSF on the detector pixels, of the same sum, with odd numbers of rows and columns and the
        origin at n // 2.

    Raises
    ------
    ValueError
        If the binning is below 1.
    """
    require_count("binning", binning)
    if binning == 1:
        return psf
    step = torch.arange(1 - binning, binning, dtype=psf.dtype)
    triangle = (binning - step.abs()) / binning
    for dim in (0, 1):
        psf = _weigh_and_sample(psf.movedim(dim, -1), triangle, binning).movedim(-1, dim)
    return psf


def _weigh_and_sample(psf: torch.Tensor, weights: torch.Tensor, step: int) -> torch.Tensor:
    """Correlate the last axis of a PSF with odd weights, and keep every `step`-th value.

    The origin, at n // 2, is kept.
    """
    n, reach = psf.shape[-1], step - 1
    most = (n // 2 + reach) // step
    left = most * step + reach - n // 2
    right = most * step + reach + 1 + n // 2 - n
    padded = torch.nn.functional.pad(psf, (left, max(right, 0)))
    rows = torch.nn.functional.conv1d(padded[:, None], weights[None, None], stride=step)[:, 0]
    return rows[:, : 2 * most + 1]


def compute_transfer(kernel: torch.Tensor, shape: tuple[int, int]) -> torch.Tensor:
    """Compute the transfer function of a PSF for pictures that are periodic.

    A PSF that is larger than the period is folded into it, so that no light is lost.

    Parameters
    ----------
    kernel : torch.Tensor, (rows, columns)
        PSF with its origin at n // 2.
    shape : tuple of int
        Rows and columns of the period.

    Returns
    -------
    torch.Tensor, (rows, columns // 2 + 1), complex
        The transfer function on the grid of rfft2.
    """
    for dim, period in enumerate(shape):
        kernel = _fold(kernel.movedim(dim, -1), period).movedim(-1, dim)
    return rfft2(origin_to_corner(kernel.contiguous()))


def _fold(kernel: torch.Tensor, period: int) -> torch.Tensor:
    """Add up samples of a PSF's last axis that lie whole periods apart; the origin is at n // 2."""
    n = kernel.shape[-1]
    before = -(-max(n // 2 - period // 2, 0) // period) * period + period // 2 - n // 2
    after = -(before + n) % period
    padded = torch.nn.functional.pad(kernel, (before, after))
    return padded.reshape(*padded.shape[:-1], -1, period).sum(-2)
