"""Pixels of a given size, as the picture of a print."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import sparse

from optics.plane import Plane
from optics.validation import require_finite
from simulator.scene.drawable import STILL, Drawable, Shift

Matrix: TypeAlias = "sparse.csr_array[Any, Any]"


def averaging_matrix(pixels: int, side: float, middle: float, edges: NDArray[np.float64]) -> Matrix:
    """Return the matrix (cells, pixels) that averages interpolated pixels over cells.

    The matrix is for one axis, in float32. The values are linear between the middles of the pixels
    and 0 beyond the outermost pixels; their means over cells are exact. pixels: number of pixels
    of `side` each, in a row around `middle`. edges: of the cells, ascending, one more than there
    are cells, in the same unit.
    """
    start = middle - pixels * side / 2
    # In the outer half of an outermost pixel there is no neighbour to interpolate with, so the
    # value is that of the pixel.
    nodes = np.concatenate([[0.0], np.arange(pixels) + 0.5, [pixels]]) * side + start
    owner = np.clip(np.arange(-1, pixels + 1), 0, pixels - 1)
    low, high = max(nodes[0], edges[0]), min(nodes[-1], edges[-1])
    shape = (len(edges) - 1, pixels)
    if low >= high:
        return sparse.csr_array(shape, dtype=np.float32)
    ends = np.union1d(nodes, edges)
    ends = ends[(ends >= low) & (ends <= high)]
    centre, length = (ends[1:] + ends[:-1]) / 2, np.diff(ends)
    cell = np.clip(np.searchsorted(edges, centre) - 1, 0, shape[0] - 1)
    piece = np.clip(np.searchsorted(nodes, centre) - 1, 0, len(nodes) - 2)
    share = (centre - nodes[piece]) / (nodes[piece + 1] - nodes[piece])
    weight = length / np.diff(edges)[cell]
    values = np.concatenate([weight * (1 - share), weight * share]).astype(np.float32)
    places = (np.tile(cell, 2), np.concatenate([owner[piece], owner[piece + 1]]))
    # The constructor adds values that have the same place.
    return sparse.csr_array((values, places), shape=shape)


def window_matrix(
    pixels: int, side: float, middle: float, window: tuple[float, float], edges: NDArray[np.float64]
) -> Matrix:
    """Return the matrix (cells, pixels) of the share of each cell that a pixel's window lights.

    It is for one axis of a display. window: its beginning and end within the pixel, in sides of a
    pixel. The other parameters are those of `averaging_matrix`.
    """
    start = (np.arange(pixels) + window[0]) * side + middle - pixels * side / 2
    end = start + (window[1] - window[0]) * side
    shape = (len(edges) - 1, pixels)
    first = np.searchsorted(edges, start, "right") - 1
    most = int(np.ceil((end[0] - start[0]) / np.diff(edges).min())) + 2
    cell = first[:, None] + np.arange(most)
    seen = (cell >= 0) & (cell < shape[0])
    inside = np.clip(cell, 0, shape[0] - 1)
    begins, ends = np.maximum(edges[inside], start[:, None]), edges[inside + 1]
    overlap = np.minimum(ends, end[:, None]) - begins
    share = np.where(seen, np.maximum(overlap, 0), 0.0) / np.diff(edges)[inside]
    pixel = np.broadcast_to(np.arange(pixels)[:, None], cell.shape)
    lit = share > 0
    places = (inside[lit], pixel[lit])
    return sparse.csr_array((share[lit].astype(np.float32), places), shape=shape)


@dataclass(frozen=True, eq=False)
class PixelPicture(Drawable):
    """Picture of pixels with values 0 to 1, interpolated linearly, and dark around its edges.

    image: (rows, columns). side: of its pixels, metres on the object; with `on_sensor`, on the
    sensor at any distance. offset: (y, x) metres on the object from the axis to the picture's
    middle.
    """

    image: torch.Tensor
    side: float
    offset: tuple[float, float] = (0.0, 0.0)
    on_sensor: bool = False

    def __post_init__(self) -> None:
        if self.image.ndim != 2 or self.image.numel() == 0:
            raise ValueError(f"image is {tuple(self.image.shape)}; it needs rows and columns")
        require_finite("image", self.image)
        if not 0 < self.side < math.inf:
            raise ValueError(f"side is {self.side:g} m; a pixel's must be positive and finite")
        if not all(math.isfinite(part) for part in self.offset):
            raise ValueError(f"offset is {self.offset} m; it must be finite in each axis")

    @property
    def bytes(self) -> int:
        """Return the bytes that the pixels take in memory."""
        return self.image.numel() * self.image.element_size()

    @property
    def grid(self) -> tuple[object, ...]:
        """Return what pictures have in common that can be added pixel by pixel."""
        return tuple(self.image.shape), self.side, self.offset, self.on_sensor

    def _side_on_sensor(self, magnification: float) -> float:
        return self.side if self.on_sensor else self.side * magnification

    def extent(self, magnification: float, shift: Shift = STILL) -> tuple[float, float]:
        side = self._side_on_sensor(magnification)
        y, x = (
            abs(offset + moved) * magnification + (n + 1) * side / 2
            for offset, moved, n in zip(self.offset, shift, self.image.shape, strict=True)
        )
        return y, x

    def spectral_decay(self, magnification: float, frequency: float) -> int:
        """Return the power of the frequency with which the spectrum falls: 1 or 2.

        Because of the linear interpolation it is 2 at frequencies beyond those that the pixels
        resolve, unless the picture has light at its rim, where it ends abruptly.
        """
        side = self._side_on_sensor(magnification)
        return 2 if side * frequency >= 0.35 and not self._ends_in_light else 1

    @cached_property
    def _ends_in_light(self) -> bool:
        return any(bool(end.any()) for end in (*self.image[[0, -1]], *self.image.mT[[0, -1]]))

    def light(self, plane: Plane, magnification: float, shift: Shift = STILL) -> torch.Tensor:
        side = self._side_on_sensor(magnification)
        if side == 0:
            return torch.zeros(plane.shape)
        matrices = [
            averaging_matrix(n, side, (offset + moved) * magnification, edges(plane, axis))
            for axis, n, offset, moved in zip(
                (0, 1), self.image.shape, self.offset, shift, strict=True
            )
        ]
        return along_both_axes(self.image, *matrices)


def along_both_axes(image: torch.Tensor, down: Matrix, across: Matrix) -> torch.Tensor:
    """Multiply a picture by matrices (cells, pixels) along its columns and rows, float32."""
    values = image.to(torch.float32).numpy()
    return torch.from_numpy(np.ascontiguousarray((across @ (down @ values).T).T))


def edges(plane: Plane, axis: int) -> NDArray[np.float64]:
    """Return the cell edges along an axis of the plane, metres: one more than there are cells."""
    n, pitch = plane.shape[axis], plane.pitch[axis]
    index = np.arange(n + 1, dtype=np.float64) - n // 2 - 0.5
    return np.asarray(index * pitch + plane.centre[axis])
