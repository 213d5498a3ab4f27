"""Mask a field at the lens by the stop, and estimate rounding from samples of the light there.

Only the cells that the stop's edge cuts are stored as numbers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray

from optics.camera.stop import Stop
from optics.camera.stop_areas import Coverage, coverage
from optics.plane import Plane

# Samples in a coarse cell, which is open, closed or cut by the edge as a whole. Sixteen rows of a
# fine grid still fit into a processor's cache.
_CELL_ROWS, _CELL_COLUMNS = 16, 64


@dataclass(frozen=True)
class MaskSegment:
    """Describes a range of columns, in a block of rows, where the stop isn't fully open.

    first, last: columns, the last one exclusive.
    share: open area of every sample, (rows, columns); None where all are closed.
    """

    first: int
    last: int
    share: torch.Tensor | None


class BlockwiseStopMask:
    """Masks fields on a plane by the open area of a stop, in blocks of rows.

    Open areas are computed only along the stop's edge.

    radius: of the stop, metres.
    """

    def __init__(self, stop: Stop, radius: float, plane: Plane, dtype: torch.dtype) -> None:
        self._stop, self._radius, self._plane, self._dtype = stop, radius, plane, dtype

    @property
    def row_blocks(self) -> list[slice]:
        count = self._plane.shape[0]
        return [slice(at, min(at + _CELL_ROWS, count)) for at in range(0, count, _CELL_ROWS)]

    @cached_property
    def segments_by_block(self) -> list[list[MaskSegment]]:
        """The column ranges, in each block of rows, where the stop isn't fully open."""
        fine = Coverage(self._stop, self._radius, self._plane)
        lines = zip(self.row_blocks, self._coarse_coverage(), strict=True)
        return [self._find_segments(fine, rows, line) for rows, line in lines]

    def _coarse_coverage(self) -> NDArray[np.float64]:
        plane, sides = self._plane, (_CELL_ROWS, _CELL_COLUMNS)
        shape = [math.ceil(n / side) for n, side in zip(plane.shape, sides, strict=True)]
        pitch = [p * side for p, side in zip(plane.pitch, sides, strict=True)]
        # The middle of a coarse cell lies between two samples.
        centre = [
            self._sample_position(axis, 0)
            - plane.pitch[axis] / 2
            + (shape[axis] // 2 + 0.5) * pitch[axis]
            for axis in (0, 1)
        ]
        coarse = Plane((shape[0], shape[1]), (pitch[0], pitch[1]), (centre[0], centre[1]))
        return np.asarray(coverage(self._stop, self._radius, coarse).numpy())

    def _sample_position(self, axis: int, number: int) -> float:
        """Return where a sample lies along an axis, in metres."""
        plane = self._plane
        return (number - plane.shape[axis] // 2) * plane.pitch[axis] + float(plane.centre[axis])

    def _find_segments(
        self, fine: Coverage, rows: slice, line: NDArray[np.float64]
    ) -> list[MaskSegment]:
        found: list[MaskSegment] = []
        kinds = np.where(line <= 0, 0, np.where(line >= 1, 2, 1))
        ends = [0, *(np.flatnonzero(np.diff(kinds)) + 1), kinds.size]
        for start, end in pairwise(ends):
            first, last = start * _CELL_COLUMNS, min(end * _CELL_COLUMNS, self._plane.shape[1])
            if kinds[start] == 1:
                share = fine.open_share(rows, slice(first, last)).to(self._dtype)
                found.append(MaskSegment(first, last, share))
            elif kinds[start] == 0:
                found.append(MaskSegment(first, last, None))
        return found

    def apply(self, field: torch.Tensor, block: int) -> None:
        """Multiply a block of a field by the stop's open share, in place.

        field: (rows, columns) of the block.
        """
        for segment in self.segments_by_block[block]:
            part = field[:, segment.first : segment.last]
            if segment.share is None:
                part.zero_()
            else:
                # Two real products take less time than one with a complex share.
                parts = torch.view_as_real(part)
                parts.mul_(segment.share.to(field.device)[..., None])

    def open_power(self, field: torch.Tensor, block: int) -> float:
        """Sum ``|field|²`` of a block over the open part of the stop.

        field: (rows, columns) of the block.
        """
        light = field.real**2 + field.imag**2
        total = float(light.sum(dtype=torch.float64))
        for segment in self.segments_by_block[block]:
            part = light[:, segment.first : segment.last]
            if segment.share is not None:
                part = part * (1 - segment.share)
            total -= float(part.sum(dtype=torch.float64))
        return total


# Roundings of double precision that the field's error may amount to, over what they would be if
# all errors in the stop added up. Chosen.
_ROUNDINGS = 4.0

PROBES = 10
"""Places along each axis of the stop at which the light there is sampled. Chosen."""


def probe_places(low: float, high: float) -> torch.Tensor:
    """Return the places between low and high at which the light in the stop is sampled."""
    share = (np.arange(PROBES) + 0.5) * (math.sqrt(5) - 1) / 2 % 1
    return torch.from_numpy(low + (high - low) * share)


@dataclass(frozen=True)
class StopProbes:
    """Holds fields of a panel's pixels at places in the stop, along an axis.

    fields: (places, pixels).
    turns: phases of the paths from the pixels, (places, pixels).
    independent: number of rows, or of nodes, whose errors are independent.
    """

    fields: torch.Tensor
    turns: torch.Tensor
    independent: int

    @property
    def light(self) -> torch.Tensor:
        """The mean light of each pixel in the stop."""
        return (self.fields.real**2 + self.fields.imag**2).mean(0)

    @property
    def noise(self) -> torch.Tensor:
        """The mean square of each pixel's errors in the stop, in roundings."""
        light = self.fields.real**2 + self.fields.imag**2
        # The share of the phase, pi per turn, is chosen, too.
        return (light * (1 + math.pi * self.turns) ** 2).mean(0) / self.independent


class StopLight:
    """Samples the light in the stop, and estimates the rounding of its integral.

    A pixel's field in the stop is known to some roundings of its value and of its phase in radians;
    these errors are independent from row to row, or from node to node. Sums of products are known
    to some roundings of their value. By Schwarz' inequality, the integral of an error over the stop
    is at most the root of the stop's area times that of its mean square.

    y, x: the light along both axes.
    area: of the stop.
    box: area of the rectangle that is probed.
    """

    def __init__(self, y: StopProbes, x: StopProbes, area: float, box: float) -> None:
        self._fields = y.fields, x.fields
        self._light, self._noise = (y.light, x.light), (y.noise, x.noise)
        self._scale = _ROUNDINGS * float(np.finfo(np.float64).eps) * math.sqrt(area * box)

    @property
    def even_error(self) -> float:
        """The error of the field at a sample of the sensor, for an evenly lit panel."""
        (y, x), (down, along) = (tuple(map(torch.sum, one)) for one in (self._light, self._noise))
        return self._scale * float((y * x).sqrt() + (down * x + y * along).sqrt())

    def error(self, modulated: torch.Tensor) -> torch.Tensor:
        """Estimate the error of the field at a sample of the sensor, (...), float64."""
        y, x = self._fields
        field = y @ modulated @ x.mT
        light = (field.real**2 + field.imag**2).mean((-2, -1))
        power = modulated.real**2 + modulated.imag**2
        (here, there), (down, along) = self._light, self._noise
        noise = (power @ there) @ down + (power @ along) @ here
        return self._scale * (light.sqrt() + noise.sqrt())
