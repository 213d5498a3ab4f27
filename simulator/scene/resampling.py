"""Rows of values, linear between their middles, averaged over cells of another size."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse


def averaging_matrix(
    pixels: int, side: float, middle: float, edges: NDArray[np.float64]
) -> sparse.csr_array[Any, Any]:
    """The matrix (cells, pixels) of an axis, float32: exact means, 0 beyond the outermost pixels.

    pixels: of `side` each, in a row around `middle`. edges: of the cells, rising, one more than
    there are cells; same unit.
    """
    start = middle - pixels * side / 2
    # Between its rim and the middle of the outermost pixel a picture is as that pixel.
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
    # What stands twice is added.
    return sparse.csr_array((values, places), shape=shape)


def window_matrix(
    pixels: int,
    side: float,
    middle: float,
    window: tuple[float, float],
    edges: NDArray[np.float64],
) -> sparse.csr_array[Any, Any]:
    """The matrix (cells, pixels) of an axis of a display: how much of each cell is lit by which
    pixel's window, float32.

    window: where it begins and ends, in sides of a pixel.
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
