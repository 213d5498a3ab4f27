"""Compute the share of each cell of a grid that a stop leaves open, exactly."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from optics.gauss_legendre import gauss_legendre
from optics.plane import Plane
from optics.stop.aperture import Array, Piece, Stop

_NODES, _WEIGHTS = gauss_legendre(16)


def coverage(stop: Stop, radius: float, plane: Plane) -> torch.Tensor:
    """Compute the share of each cell of a plane that a stop leaves open, float64.

    radius: of the stop, metres.
    """
    return Coverage(stop, radius, plane).open_share(
        slice(0, plane.shape[0]), slice(0, plane.shape[1])
    )


class Coverage:
    """Computes the open share of the cells of a plane behind a stop of `radius` metres.

    By Green's theorem, the open area of a cell is a sum over the stop's boundary: (x - left side of
    the cell) dy inside the cell, plus the cell's width times dy wherever the boundary passes to the
    right of the cell. So one pass along the boundary is enough for all cells.
    """

    def __init__(self, stop: Stop, radius: float, plane: Plane) -> None:
        self._pitch = (plane.pitch[0] / radius, plane.pitch[1] / radius)
        lines = [_cell_edges(plane, axis) / radius for axis in (0, 1)]
        steps = [
            _integrate_along_piece(piece, loop.sign, lines)
            for loop in stop.loops
            for piece in loop.pieces
        ]
        row, column, strip, step, sweep = (
            np.concatenate(part) for part in zip(*steps, strict=True)
        )
        order = np.argsort(row, kind="stable")
        self._row, self._column = row[order], column[order]
        self._strip, self._step, self._sweep = strip[order], step[order], sweep[order]
        self._radius, self._shape = radius, plane.shape

    def open_share(self, rows: slice, columns: slice) -> torch.Tensor:
        """Return the share of each cell in these rows and columns that the stop leaves open.

        The result is float64.
        """
        part = slice(*np.searchsorted(self._row, (rows.start, rows.stop)))
        row, column = self._row[part] - rows.start, self._column[part] - columns.start
        on = column >= 0
        row, column = row[on], column[on]
        strip, step = self._strip[part][on], self._step[part][on]
        width = columns.stop - columns.start
        inside = np.zeros((rows.stop - rows.start, width))
        passed = np.zeros((rows.stop - rows.start, width + 1))
        np.add.at(passed, (row, np.minimum(column, width)), step)
        here = column < width
        np.add.at(inside, (row[here], column[here]), strip[here])
        # Boundary to the right of a cell is also to the right of all cells left of it.
        right = np.cumsum(passed[:, ::-1], axis=1)[:, ::-1]
        cell = self._pitch[0] * self._pitch[1]
        share = (inside + right[:, 1:] * self._pitch[1]) / cell
        # Rounding must not let light through a closed cell. The rounding error of an area from its
        # boundary is about 2e-14 square stop radii.
        least = 2e-14 / cell
        share[share < least] = 0.0
        share[share > 1 - least] = 1.0
        return torch.from_numpy(share)

    def radius_derivative(self) -> torch.Tensor:
        """Return the derivative of every cell's open share in the stop's radius, 1/m, float64.

        A boundary point at b radii from the axis moves by b when the radius grows by one metre.
        The area that an element of the boundary sweeps is the component of b along the outward
        normal times the element's length, which is x dy - y dx.
        """
        rate = np.zeros(self._shape)
        here = (self._column >= 0) & (self._column < self._shape[1])
        np.add.at(rate, (self._row[here], self._column[here]), self._sweep[here])
        return torch.from_numpy(rate / (self._pitch[0] * self._pitch[1] * self._radius))


def _cell_edges(plane: Plane, axis: int) -> Array:
    n, p = plane.shape[axis], plane.pitch[axis]
    return (np.arange(n + 1, dtype=np.float64) - n // 2 - 0.5) * p + float(plane.centre[axis])


def _integrate_along_piece(
    piece: Piece, sign: int, lines: list[Array]
) -> tuple[NDArray[np.int64], NDArray[np.int64], Array, Array, Array]:
    """Divide a piece of a stop's boundary at the grid's lines and integrate over each step.

    Returns each step's row, its column, the integral of (x - left side of the cell) dy, the
    integral of dy, and that of x dy - y dx. A step beyond the grid's right side has the column
    after the last.
    """
    count = [line.size - 1 for line in lines]
    cuts = [piece.crossings(axis, lines[axis]) for axis in (0, 1)]
    t = np.unique(np.concatenate([[0.0], *cuts, [1.0]]))
    half, middle = np.diff(t) / 2, (t[:-1] + t[1:]) / 2
    at = middle[:, None] + half[:, None] * _NODES
    y, x = piece.points(at)
    # The midpoint of a step could lie on a line that an arc touches. The mean of its points
    # doesn't.
    row = np.searchsorted(lines[0], y.mean(axis=1)) - 1
    column = np.searchsorted(lines[1], x.mean(axis=1)) - 1
    on = (row >= 0) & (row < count[0]) & (column >= 0)
    row, column, half, at, y, x = row[on], column[on], half[on], at[on], y[on], x[on]
    dy, dx = piece.velocity(at)
    step = sign * half * (dy @ _WEIGHTS)
    strip = sign * half * (((x - lines[1][column][:, None]) * dy) @ _WEIGHTS)
    sweep = sign * half * ((x * dy - y * dx) @ _WEIGHTS)
    return row, column, strip, step, sweep
