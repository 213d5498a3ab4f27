"""The share of each cell of a grid that lies in a stop, exactly."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from optics.plane import Plane
from optics.stop.aperture import Array, Piece, Stop

_ROUNDING = 2e-14
"""Of an area that is walked around, in square stop radii."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)


def coverage(stop: Stop, radius: float, plane: Plane) -> torch.Tensor:
    """Share of each cell of a plane that a stop of `radius` metres leaves open, float64.

    By Green's theorem the part of a cell in the stop is the sum over the boundary of
    (x - left side of the cell) dy inside the cell, plus the cell's width times dy wherever
    the boundary passes the cell on its right: one walk along the boundary fills a picture.
    """
    pitch = (plane.pitch[0] / radius, plane.pitch[1] / radius)
    lines = [_cell_edges(plane, axis) / radius for axis in (0, 1)]
    rows, columns = plane.shape
    inside = np.zeros((rows, columns))
    passed = np.zeros((rows, columns + 1))
    for loop in stop.loops:
        for piece in loop.pieces:
            _walk(piece, loop.sign, lines, inside, passed)
    # What passes on the right of a cell passes on the right of all cells left of it.
    right = np.cumsum(passed[:, ::-1], axis=1)[:, ::-1]
    cell = pitch[0] * pitch[1]
    share = (inside + right[:, 1:] * pitch[1]) / cell
    # Rounding must not let light through what is closed.
    least = _ROUNDING / cell
    share[share < least] = 0.0
    share[share > 1 - least] = 1.0
    return torch.from_numpy(share)


def _cell_edges(plane: Plane, axis: int) -> Array:
    n, p = plane.shape[axis], plane.pitch[axis]
    return (np.arange(n + 1, dtype=np.float64) - n // 2 - 0.5) * p + float(plane.centre[axis])


def _walk(
    piece: Piece,
    sign: int,
    lines: list[Array],
    inside: NDArray[np.float64],
    passed: NDArray[np.float64],
) -> None:
    """Add a piece of the boundary, cut where it crosses the lines of the grid."""
    rows, columns = inside.shape
    cuts = [piece.crossings(axis, lines[axis]) for axis in (0, 1)]
    t = np.unique(np.concatenate([[0.0], *cuts, [1.0]]))
    half, middle = np.diff(t) / 2, (t[:-1] + t[1:]) / 2
    at = middle[:, None] + half[:, None] * _NODES
    y, x = piece.points(at)
    # A point in the middle could lie on a line that an arc touches; the mean doesn't.
    row = np.searchsorted(lines[0], y.mean(axis=1)) - 1
    column = np.searchsorted(lines[1], x.mean(axis=1)) - 1
    on = (row >= 0) & (row < rows) & (column >= 0)
    row, column, half, at, x = row[on], column[on], half[on], at[on], x[on]
    dy, _ = piece.velocity(at)
    step = sign * half * (dy @ _WEIGHTS)
    right_of_all = column >= columns
    np.add.at(passed, (row, np.minimum(column, columns)), step)
    left = lines[1][np.minimum(column, columns)]
    strip = sign * half * (((x - left[:, None]) * dy) @ _WEIGHTS)
    on_grid = ~right_of_all
    np.add.at(inside, (row[on_grid], column[on_grid]), strip[on_grid])
