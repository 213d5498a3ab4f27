"""How surely a kernel is known: what parts of a photograph say, and a search from elsewhere."""

from __future__ import annotations

import math
from collections.abc import Callable

import torch

from optics.deconvolution.blind.kernel_search import NormalisedPhotograph
from optics.plane import centred_pad
from optics.progress import Progress

RefineKernel = Callable[[NormalisedPhotograph, torch.Tensor, Progress], torch.Tensor]
"""A kernel from a photograph and a kernel near by."""

_PARTS = 2
"""Of the photograph, each way."""

_DEVIATION_FACTOR = 2.0
"""Of the deviation, by which what all parts have in common is allowed for: measured on photographs
whose kernels are known."""

_SUBPIXEL_STEPS = 4
"""Steps of a pixel by which kernels are moved."""

_NEIGHBOURS = 3
"""Pixels each way whose deviations are taken for alike."""


def kernel_deviation(
    photo: NormalisedPhotograph,
    kernel: torch.Tensor,
    rival: torch.Tensor,
    refine: RefineKernel,
    progress: Progress,
) -> torch.Tensor:
    """Standard deviation of each pixel of a kernel, which `refine` finds anew.

    Parts of the photograph that share no pixel go the same way again; the mean of so many has a
    variance that is smaller by their number. rival: a kernel of the same size that was found from
    another start: where a search hasn't got to the end, it shows, as parts that go on from the
    same kernel can't (Gelman and Rubin 1992, doi 10.1214/ss/1177011136).
    """
    rows, columns = photo.image.shape
    square = torch.zeros_like(kernel)
    for number in range(_PARTS**2):
        y, x = divmod(number, _PARTS)
        part = photo.crop(_part_slice(rows, y), _part_slice(columns, x))
        told = progress.part(number / _PARTS**2, (number + 1) / _PARTS**2)
        square += (align_kernel(refine(part, kernel, told), kernel) - kernel).square()
    spread = _DEVIATION_FACTOR**2 * square / _PARTS**2 / (_PARTS**2 - 1)
    spread = spread + (align_kernel(rival, kernel) - kernel).square()
    pooled = torch.nn.functional.avg_pool2d(spread[None, None], _NEIGHBOURS, 1, _NEIGHBOURS // 2)[
        0, 0
    ]
    return pooled.sqrt()


def align_kernel(kernel: torch.Tensor, reference: torch.Tensor) -> torch.Tensor:
    """Moved, by parts of a pixel, to where it is most like another one of the same size: where the
    scene lay nobody can tell."""
    rows, columns = reference.shape
    period = (2 * rows, 2 * columns)
    spectrum = torch.fft.fft2(kernel, s=period)
    cross = spectrum.conj() * torch.fft.fft2(reference, s=period)
    fine = centred_pad(torch.fft.fftshift(cross), tuple(_SUBPIXEL_STEPS * n for n in period))
    likeness = torch.fft.ifft2(torch.fft.ifftshift(fine)).real
    place = int(likeness.argmax())
    y, x = divmod(place, likeness.shape[1])
    way = [
        (at if at < n // 2 else at - n) / _SUBPIXEL_STEPS
        for at, n in zip((y, x), likeness.shape, strict=True)
    ]
    turn = [
        torch.exp(-2j * math.pi * torch.fft.fftfreq(n) * shift)
        for n, shift in zip(period, way, strict=True)
    ]
    moved = torch.fft.ifft2(spectrum * turn[0][:, None] * turn[1]).real
    return moved[:rows, :columns].to(kernel)


def _part_slice(length: int, number: int) -> slice:
    return slice(math.floor(length * number / _PARTS), math.floor(length * (number + 1) / _PARTS))
