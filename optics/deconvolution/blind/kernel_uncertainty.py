"""The uncertainty of a blur kernel, from parts of the photograph and from a second search."""

from __future__ import annotations

import math
from collections.abc import Callable

import torch

from optics.deconvolution.blind.kernel_search import NormalisedPhotograph
from optics.plane import centred_pad
from optics.progress import Progress

RefineKernel = Callable[[NormalisedPhotograph, torch.Tensor, Progress], torch.Tensor]
"""A function that refines a kernel for a photograph, starting from a similar kernel."""

_PARTS = 2
"""Number of parts into which the photograph is divided along each axis."""


def kernel_deviation(
    photo: NormalisedPhotograph,
    kernel: torch.Tensor,
    rival: torch.Tensor,
    refine: RefineKernel,
    progress: Progress,
) -> torch.Tensor:
    """Estimate the standard deviation of each pixel of a blindly estimated blur kernel.

    `refine` estimates the kernel again from parts of the photograph that share no pixel. The
    variance of the mean of these kernels is their variance over their number. `rival` is a kernel
    of the same size that was found from another start. Its difference from the kernel shows whether
    the search has converged, which the parts can't show, since they start from the same kernel
    (Gelman and Rubin 1992, doi 10.1214/ss/1177011136).
    """
    rows, columns = photo.image.shape
    square = torch.zeros_like(kernel)
    for number in range(_PARTS**2):
        y, x = divmod(number, _PARTS)
        part = photo.crop(_part_slice(rows, y), _part_slice(columns, x))
        told = progress.part(number / _PARTS**2, (number + 1) / _PARTS**2)
        square += (align_kernel(refine(part, kernel, told), kernel) - kernel).square()
    # The factor of 2 in the deviation allows for the error that all parts share. It was measured on
    # photographs with known kernels.
    spread = 2.0**2 * square / _PARTS**2 / (_PARTS**2 - 1)
    spread = spread + (align_kernel(rival, kernel) - kernel).square()
    # Neighbouring pixels of the kernel are taken to have similar variances.
    pooled = torch.nn.functional.avg_pool2d(spread[None, None], 3, 1, 1)[0, 0]
    return pooled.sqrt()


def align_kernel(kernel: torch.Tensor, reference: torch.Tensor) -> torch.Tensor:
    """Shift a blindly estimated blur kernel to the best match with a reference kernel.

    The shift is a multiple of a quarter pixel, and both kernels have the same size. The position of
    a kernel is arbitrary, since the photograph doesn't show where the scene was before the blur.
    """
    steps = 4
    rows, columns = reference.shape
    period = (2 * rows, 2 * columns)
    spectrum = torch.fft.fft2(kernel, s=period)
    cross = spectrum.conj() * torch.fft.fft2(reference, s=period)
    fine = centred_pad(torch.fft.fftshift(cross), tuple(steps * n for n in period))
    likeness = torch.fft.ifft2(torch.fft.ifftshift(fine)).real
    place = int(likeness.argmax())
    y, x = divmod(place, likeness.shape[1])
    way = [
        (at if at < n // 2 else at - n) / steps
        for at, n in zip((y, x), likeness.shape, strict=True)
    ]
    turn = [
        torch.exp(-2j * math.pi * torch.fft.fftfreq(n) * shift)
        for n, shift in zip(period, way, strict=True)
    ]
    moved = torch.fft.ifft2(spectrum * turn[0][:, None] * turn[1]).real
    return moved[:rows, :columns].to(kernel)


def _part_slice(length: int, number: int) -> slice:
    """Return the slice of one of the photograph's parts for blind deconvolution, along an axis.

    `length` is the length of the axis.
    """
    return slice(math.floor(length * number / _PARTS), math.floor(length * (number + 1) / _PARTS))
