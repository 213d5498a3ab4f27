"""Pictures of polygons, drawn with the exact share of each cell that they cover."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from optics.plane import Plane
from optics.validation import require_positive
from simulator.scene.drawable import STILL, Drawable, Shift
from simulator.scene.pixel_picture import PixelPicture

Corners = tuple[tuple[float, float], ...]
"""Corners (y, x) in metres on the object, clockwise or not; the last is joined to the first."""


@dataclass(frozen=True)
class Polygons(Drawable):
    """Picture of evenly lit polygons on an even background.

    corners: of each polygon. values: of each polygon, 0 to 1. ground: value of the background.
    Where polygons overlap, their differences from the background add up.
    """

    corners: tuple[Corners, ...]
    values: tuple[float, ...]
    ground: float = 0.0

    def __post_init__(self) -> None:
        if len(self.corners) != len(self.values):
            raise ValueError(
                f"{len(self.corners)} polygons and {len(self.values)} values are given; give one "
                "for each"
            )
        for polygon in self.corners:
            if len(polygon) < 3 or not np.isfinite(polygon).all():
                raise ValueError("a polygon has fewer than 3 corners, or one that isn't finite")

    def extent(self, magnification: float, shift: Shift = STILL) -> tuple[float, float]:
        if self.ground:
            return super().extent(magnification, shift)
        places = np.concatenate([np.asarray(polygon) for polygon in self.corners]) + shift
        y, x = (np.abs(places) * magnification).max(axis=0).tolist()
        return y, x

    def light(self, plane: Plane, magnification: float, shift: Shift = STILL) -> torch.Tensor:
        origin = [s * magnification for s in shift]
        placed = [np.asarray(polygon) * magnification + origin for polygon in self.corners]
        weights = [value - self.ground for value in self.values]
        return torch.from_numpy(polygon_coverage(plane, placed, weights, self.ground))


def polygon_coverage(
    plane: Plane,
    polygons: Sequence[NDArray[np.float64]],
    weights: Sequence[float],
    ground: float = 0.0,
) -> NDArray[np.float32]:
    """Return the weighted share of each cell that polygons cover, plus `ground`.

    polygons: (corners, 2), y and x in metres. Each edge adds, to the cells that it crosses, the
    exact area to its right; cumulative sums along the rows then fill the polygons, as in R.
    Levien's font-rs.
    """
    if not polygons:
        return np.full(plane.shape, ground, dtype=np.float32)
    rows, columns = plane.shape
    origin = np.array(plane.centre) - (np.array(plane.shape) // 2 + 0.5) * plane.pitch
    cells = [(np.asarray(corners) - origin) / plane.pitch for corners in polygons]
    starts = np.concatenate(cells)
    ends = np.concatenate([np.roll(one, -1, axis=0) for one in cells])
    signed = np.repeat(
        [w * _orientation(one) for w, one in zip(weights, cells, strict=True)],
        [len(one) for one in cells],
    )
    marks = _edge_contributions(plane.shape, starts, ends, signed)
    shares = np.cumsum(marks.reshape(rows, columns + 1)[:, :columns], axis=1)
    return (shares + ground).astype(np.float32)


def _orientation(corners: NDArray[np.float64]) -> float:
    """Return 1 if a polygon lies to the right of its downward edges, or else -1."""
    y, x = (corners - corners.mean(axis=0)).T
    area = float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))
    return -math.copysign(1.0, area)


def _edge_contributions(
    shape: tuple[int, int],
    starts: NDArray[np.float64],
    ends: NDArray[np.float64],
    weights: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the area that edges add to each cell, which the caller sums along the rows.

    starts, ends: (edges, 2), y and x in cells from the plane's corner. The result, flattened, has
    one column more than the plane.
    """
    rows, columns = shape
    edge, t = _cut(shape, starts, ends)
    at = starts[edge] + t[:, None] * (ends - starts)[edge]
    piece = np.flatnonzero(edge[1:] == edge[:-1])
    middle = (at[piece] + at[piece + 1]) / 2
    seen = (middle[:, 0] > 0) & (middle[:, 0] < rows) & (middle[:, 1] < columns)
    piece, middle = piece[seen], middle[seen]
    down = (at[piece + 1, 0] - at[piece, 0]) * weights[edge[piece]]
    row = np.floor(middle[:, 0]).astype(np.int64)
    # An edge to the left of the plane has all of its rows on its right.
    position = np.maximum(middle[:, 1], 0.0)
    column = np.minimum(np.floor(position).astype(np.int64), columns - 1)
    beyond = position - column
    index = row * (columns + 1) + column
    size = rows * (columns + 1)
    own = np.bincount(index, down * (1 - beyond), size)
    return np.asarray(own + np.bincount(index + 1, down * beyond, size), dtype=np.float64)


def _cut(
    shape: tuple[int, int], starts: NDArray[np.float64], ends: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Cut edges where they cross from cell to cell.

    Returns the edge and the position on it, 0 to 1 and ascending, of each beginning, crossing and
    end.
    """
    every = np.arange(len(starts))
    edges, places = [every, every], [np.zeros(len(starts)), np.ones(len(starts))]
    for axis in (0, 1):
        a, b = starts[:, axis], ends[:, axis]
        first = np.ceil(np.clip(np.minimum(a, b), 0, shape[axis])).astype(np.int64)
        last = np.floor(np.clip(np.maximum(a, b), 0, shape[axis])).astype(np.int64)
        count = np.where(a == b, 0, np.maximum(last - first + 1, 0))
        edge = np.repeat(every, count)
        line = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count) + first[edge]
        t = (line - a[edge]) / (b - a)[edge]
        inner = (t > 0) & (t < 1)
        edges.append(edge[inner])
        places.append(t[inner])
    edge, t = np.concatenate(edges), np.concatenate(places)
    order = np.lexsort((t, edge))
    return edge[order], t[order]


WeightedPicture = tuple[Drawable, float]
"""A picture and the weight of its values."""


def merge_pictures(pictures: Iterable[WeightedPicture]) -> list[WeightedPicture]:
    """Merge pictures into fewer with the same weighted sum, without those of weight 0."""
    kinds: dict[object, list[WeightedPicture]] = {}
    for number, (picture, weight) in enumerate(pictures):
        kind: object = number
        if isinstance(picture, PixelPicture):
            kind = picture.grid
        elif isinstance(picture, Polygons):
            kind = picture.corners
        if weight:
            kinds.setdefault(kind, []).append((picture, weight))
    return [_one(alike) for alike in kinds.values()]


def _one(alike: Sequence[WeightedPicture]) -> WeightedPicture:
    """Merge pictures of one kind into one picture and its weight."""
    first, weight = alike[0]
    if len(alike) == 1:
        return first, weight
    if isinstance(first, PixelPicture):
        image = sum(p.image * w for p, w in alike if isinstance(p, PixelPicture))
        return replace(first, image=image), 1.0  # type: ignore[arg-type]
    assert isinstance(first, Polygons)
    both = [(p, w) for p, w in alike if isinstance(p, Polygons)]
    values = tuple(sum(p.values[k] * w for p, w in both) for k in range(len(first.values)))
    return Polygons(first.corners, values, sum(p.ground * w for p, w in both)), 1.0


def rectangle(
    centre: tuple[float, float], size: tuple[float, float], angle: float = 0.0
) -> Corners:
    """Return the corners of a rectangle, in metres.

    centre: (y, x). size: (height, width). angle: rotation from x towards y, radians.
    """
    cos, sin = math.cos(angle), math.sin(angle)
    half_y, half_x = size[0] / 2, size[1] / 2
    corners = []
    for sy, sx in ((-1, -1), (-1, 1), (1, 1), (1, -1)):
        y = centre[0] + sy * half_y * cos + sx * half_x * sin
        corners.append((y, centre[1] + sx * half_x * cos - sy * half_y * sin))
    return tuple(corners)


def brick(
    size: tuple[float, float], studs: int = 4, offset: tuple[float, float] = (0.0, 0.0)
) -> tuple[Polygons, Polygons]:
    """Draw the front of a toy brick with studs, and return its picture and its cover.

    The cover is 1 where the brick hides what lies behind it. size: (height, width) of the brick's
    body, metres, whose middle is at `offset`. Raises ValueError for fewer than one stud.
    """
    require_positive("height", size[0], "m")
    require_positive("width", size[1], "m")
    if studs < 1:
        raise ValueError(f"studs is {studs}; a brick has 1 or more")
    # A stud is 1.8 mm high on a body of 9.6 mm, and 4.8 mm wide in a cell of 8 mm.
    stud_height, stud_width = 0.19, 0.6
    # The foot is a darker strip; its height is a share of the body's height.
    foot_share, foot_tone, stud_tone = 0.08, 0.85, 0.75
    (height, width), (y, x) = size, offset
    body = rectangle(offset, size)
    foot = rectangle((y + height * (1 - foot_share) / 2, x), (height * foot_share, width))
    cell, top = width / studs, y - height * (1 + stud_height) / 2
    places = [(top, x + (k - (studs - 1) / 2) * cell) for k in range(studs)]
    tops = [rectangle(one, (height * stud_height, cell * stud_width)) for one in places]
    tones = (1.0, foot_tone - 1, *[stud_tone] * studs)
    return Polygons((body, foot, *tops), tones), Polygons((body, *tops), (1.0,) * (1 + studs))
