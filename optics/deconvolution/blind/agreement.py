"""How surely a kernel is known: what parts of a photograph say by themselves."""

from __future__ import annotations

import math
from collections.abc import Callable

import torch

from optics.deconvolution.blind.search import Photograph
from optics.progress import Progress

Again = Callable[[Photograph, torch.Tensor, Progress], torch.Tensor]
"""A kernel from a photograph and a kernel near by."""

_PARTS = 2
"""Of the photograph, each way."""

_CAUTION = 2.0
"""Of the deviation, by which what all parts have in common is allowed for: measured on photographs
whose kernels are known."""

_NEIGHBOURS = 3
"""Pixels each way whose deviations are taken for alike."""


def deviation_of(
    photo: Photograph,
    kernel: torch.Tensor,
    again: Again,
    progress: Progress,
) -> torch.Tensor:
    """Standard deviation of each pixel of a kernel, which `again` finds anew.

    Parts of the photograph that share no pixel go the same way again; the mean of so many has a
    variance that is smaller by their number.
    """
    rows, columns = photo.image.shape
    square = torch.zeros_like(kernel)
    for number in range(_PARTS**2):
        y, x = divmod(number, _PARTS)
        part = photo.part(_share(rows, y), _share(columns, x))
        told = progress.part(number / _PARTS**2, (number + 1) / _PARTS**2)
        square += (again(part, kernel, told) - kernel).square()
    spread = square / _PARTS**2 / (_PARTS**2 - 1)
    pooled = torch.nn.functional.avg_pool2d(spread[None, None], _NEIGHBOURS, 1, _NEIGHBOURS // 2)[
        0, 0
    ]
    return _CAUTION * pooled.sqrt()


def _share(length: int, number: int) -> slice:
    return slice(math.floor(length * number / _PARTS), math.floor(length * (number + 1) / _PARTS))
