"""Resampling of a picture's pixels to the cells of another grid, as sparse matrices."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse


def averaging_matrix(
    pixels: int, side: float, middle: float, edges: NDArray[np.float64]
) -> sparse.csr_array[Any, Any]:
    """Return the matrix (cells, pixels) that averages a scene's interpolated pixels over cells.

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
    pixels: int,
    side: float,
    middle: float,
    window: tuple[float, float],
    edges: NDArray[np.float64],
) -> sparse.csr_array[Any, Any]:
    """Return the matrix (cells, pixels) of how much of each cell a scene's display lights.

    An element is the share of the cell that the pixel's window lights. The matrix is for one axis
    of a display, in float32. window: its beginning and end within the pixel, in sides of a pixel.
    The other parameters are those of `averaging_matrix`.
    """
    start = (np.arange(pixels) + window[0]) * side + middle - pixels * side / 2
    end = start + (window[1] - window[0]) * side
    shape = (len(edges) - 1, pixels)
    first = np.searchsorted(edges, start, "right") - 1
    most = int(np.ceil((end[0] - start[0]) / np.diff(edges).min())) + 2
    cell = first[:, None] + np.arange(most)
    seen = (cell >= 0) & (cell < shape[0])
    inside = np.clip(cell, 0, shape[0] - 1)
    overlap = np.minimum(edges[inside + 1], end[:, None]) - np.maximum(
        edges[inside], start[:, None]
    )
    share = np.where(seen, np.maximum(overlap, 0), 0.0) / np.diff(edges)[inside]
    pixel = np.broadcast_to(np.arange(pixels)[:, None], cell.shape)
    lit = share > 0
    places = (inside[lit], pixel[lit])
    return sparse.csr_array((share[lit].astype(np.float32), places), shape=shape)
