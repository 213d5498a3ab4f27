"""Describe where samples lie: shape, pitch and centre of a plane across the optical axis."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from optics.validation import as_number

_LONGEST = 1 << 50  # samples along an axis, whose places are still told apart by doubles


@dataclass(frozen=True)
class Plane:
    """Describe a regular grid of samples in a plane across the optical axis.

    shape: (rows, columns). pitch: (y, x) distance between samples in metres.
    centre: (y, x) position in metres of the origin sample, whose index is n // 2 on each axis,
    for even and for odd n.
    """

    shape: tuple[int, int]
    pitch: tuple[float, float]
    centre: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        whole = [isinstance(n, (int, np.integer)) and not isinstance(n, bool) for n in self.shape]
        if not all(whole) or len(whole) != 2:
            raise TypeError(f"shape {self.shape} must be two whole numbers, (rows, columns)")
        if not max(self.shape) < _LONGEST:
            raise ValueError(
                f"shape {self.shape} has more samples along an axis than doubles tell apart; give "
                f"at most {_LONGEST:g}"
            )
        if min(self.shape) < 1:
            raise ValueError(f"shape {self.shape} must be at least 1 in each axis")
        if not all(0 < p < math.inf for p in self.pitch):
            raise ValueError(f"pitch {self.pitch} m must be positive and finite in each axis")
        centre = tuple(as_number(c) for c in self.centre)
        if not all(math.isfinite(c) for c in centre):
            raise ValueError(f"centre {centre} m must be finite in each axis")

    def coordinates(self, axis: int) -> torch.Tensor:
        """Return the samples' positions along axis 0 (y) or 1 (x), metres, float64."""
        n = self.shape[axis]
        index = torch.arange(n, dtype=torch.float64) - n // 2
        return index * self.pitch[axis] + self.centre[axis]

    def mesh(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the samples' positions (y, x) as a column and a row that broadcast, in metres."""
        return self.coordinates(0)[:, None], self.coordinates(1)[None, :]

    def with_finer_pitch(self, factor: int) -> Plane:
        """Return a plane of the same centre and size with `factor` times the samples per axis."""
        if factor < 1:
            raise ValueError(f"factor is {factor}; a finer plane needs at least 1")
        return Plane(
            (self.shape[0] * factor, self.shape[1] * factor),
            (self.pitch[0] / factor, self.pitch[1] / factor),
            self.centre,
        )


@dataclass(frozen=True, eq=False)
class RectilinearGrid:
    """Samples in rows and columns that needn't be evenly spaced; y, x: metres, float64."""

    y: torch.Tensor
    x: torch.Tensor
    centre: tuple[float, float] = (0.0, 0.0)

    @property
    def shape(self) -> tuple[int, int]:
        return self.y.numel(), self.x.numel()

    def coordinates(self, axis: int) -> torch.Tensor:
        """Return the samples' positions along axis 0 (y) or 1 (x), metres, float64."""
        return self.x if axis else self.y

    def mesh(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the samples' positions (y, x) as a column and a row that broadcast, in metres."""
        return self.y[:, None], self.x[None, :]


def centred_crop(array: torch.Tensor, shape: Sequence[int]) -> torch.Tensor:
    """Crop the last two axes around the origin, which stays at n // 2.

    Raises ValueError if `shape` is larger than the array.
    """
    rows, columns = array.shape[-2:]
    if shape[0] > rows or shape[1] > columns:
        raise ValueError(f"cannot crop {(rows, columns)} to the larger shape {shape}")
    y, x = rows // 2 - shape[0] // 2, columns // 2 - shape[1] // 2
    return array[..., y : y + shape[0], x : x + shape[1]]


def centred_pad(array: torch.Tensor, shape: Sequence[int]) -> torch.Tensor:
    """Pad the last two axes with zeros; the origin stays at n // 2."""
    rows, columns = array.shape[-2:]
    if shape[0] < rows or shape[1] < columns:
        raise ValueError(f"cannot pad {(rows, columns)} to the smaller shape {shape}")
    y, x = shape[0] // 2 - rows // 2, shape[1] // 2 - columns // 2
    margins = (x, shape[1] - columns - x, y, shape[0] - rows - y)
    return torch.nn.functional.pad(array, margins)


def origin_to_corner(array: torch.Tensor) -> torch.Tensor:
    """Move the origin from n // 2 to index 0 on the last two axes, as FFTs need."""
    return torch.fft.ifftshift(array, dim=(-2, -1))


def origin_to_centre(array: torch.Tensor) -> torch.Tensor:
    """Move the origin from index 0 to n // 2 on the last two axes."""
    return torch.fft.fftshift(array, dim=(-2, -1))
