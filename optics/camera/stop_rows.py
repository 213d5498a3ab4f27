"""Quadrature over a stop by rows, whose open stretches end on curves of its boundary.

An integral along a row may then be computed from one antiderivative, for all rows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import combinations, pairwise

import numpy as np
from numpy.typing import NDArray

from optics.camera.stop import NEGLIGIBLE, Circle, Point, Shape, Stop
from optics.camera.stop_areas import outline_intersections
from optics.camera.stop_nodes import line_rule, line_rule_node_count

Array = NDArray[np.float64]
Curve = Callable[[Array], Array]
"""A piece of the stop's boundary: x at heights y, in stop radii."""

_SAMPLES = 32  # angles at which the speed of a row's ends is found

_SPEED_MARGIN = 1.2  # factor on that speed, because the ends are followed at few angles only


@dataclass(frozen=True)
class RowBand:
    """Heights between which the same curves cut all rows.

    low, high: heights in stop radii.
    stretches: the curves (left, right) between which the rows are open.
    """

    low: float
    high: float
    stretches: tuple[tuple[Curve, Curve], ...]

    def heights(self, angle: Array) -> Array:
        """Return heights that cluster at both ends of the band, for angles -pi/2 to pi/2.

        Where a curve is tangent to a row, the stretches still change smoothly in the angle.
        """
        return (self.low + self.high) / 2 + (self.high - self.low) / 2 * np.sin(angle)

    def slope(self, down: float, along: float) -> float:
        """Bound how fast the phase of an integral along the rows changes, radians per radian.

        down, along: the steepest slopes of the phase in y and x, radians per stop radius.
        """
        angle = np.linspace(-math.pi / 2, math.pi / 2, _SAMPLES + 1)
        y, step = self.heights(angle), math.pi / _SAMPLES
        curves = {curve for stretch in self.stretches for curve in stretch}
        moved = np.max([np.abs(np.diff(curve(y))) for curve in curves], axis=0, initial=0.0)
        slopes = (down * np.abs(np.diff(y)) + along * moved) / step
        return _SPEED_MARGIN * float(slopes.max())


@dataclass(frozen=True)
class Rows:
    """Rows for a quadrature, and the ends of their open stretches; lengths in stop radii.

    y, weight: height of each row, and its weight in the integral over the heights.
    row: number of each end's row.
    end: where it lies in x.
    sign: 1 for a stretch's right end, -1 for its left one.
    """

    y: Array
    weight: Array
    row: NDArray[np.int64]
    end: Array
    sign: Array

    def split(self, most: int) -> Iterator[Rows]:
        """Yield the rows in parts of no more than `most`, in order."""
        by_row = np.argsort(self.row, kind="stable")
        starts = range(0, len(self.y), most)
        for start, ends in zip(
            starts, np.split(by_row, np.searchsorted(self.row[by_row], starts[1:])), strict=True
        ):
            part = slice(start, start + most)
            yield Rows(
                self.y[part],
                self.weight[part],
                self.row[ends] - start,
                self.end[ends],
                self.sign[ends],
            )


def row_bands(stop: Stop) -> list[RowBand]:
    """Divide a stop into bands of rows, in each of which the same curves cut the rows."""
    shapes = (stop.opening, *stop.obscurations)
    breaks: list[float] = []
    for shape in shapes:
        # A shape's corners, or a disc's lowest and highest point.
        places = shape.extent if isinstance(shape, Circle) else shape.corners
        breaks += [y for y, _ in places]
    breaks += [y for a, b in combinations(shapes, 2) for y, _ in outline_intersections(a, b)]
    low, high = (end[0] for end in stop.opening.extent)
    kept = [low]
    for y in sorted(breaks):
        if kept[-1] + NEGLIGIBLE < y < high - NEGLIGIBLE:
            kept.append(y)
    bands = (RowBand(a, b, _open_stretches(stop, a, b)) for a, b in pairwise([*kept, high]))
    return [band for band in bands if band.stretches]


def count_rows(bands: list[RowBand], down: float, along: float, tol: float) -> list[int]:
    """Count the rows in each band that a tolerance takes; slopes as for RowBand.slope()."""
    return [line_rule_node_count(math.pi, band.slope(down, along), tol) for band in bands]


def quadrature_rows(bands: list[RowBand], down: float, along: float, tol: float) -> Rows:
    """Return the rows that a tolerance takes; slopes as for RowBand.slope()."""
    y, weight, row, end, sign, count = [], [], [], [], [], 0
    for band in bands:
        t, share = line_rule(math.pi, band.slope(down, along), tol)
        angle = math.pi * (t - 0.5)
        y.append(band.heights(angle))
        weight.append(math.pi * share * np.cos(angle) * (band.high - band.low) / 2)
        for stretch in band.stretches:
            for curve, side in zip(stretch, (-1.0, 1.0), strict=True):
                row.append(count + np.arange(t.size))
                end.append(curve(y[-1]))
                sign.append(np.full(t.size, side))
        count += t.size
    return Rows(
        np.concatenate(y),
        np.concatenate(weight),
        np.concatenate(row),
        np.concatenate(end),
        np.concatenate(sign),
    )


def _open_stretches(stop: Stop, low: float, high: float) -> tuple[tuple[Curve, Curve], ...]:
    """Return the curves between which rows from `low` to `high` are open, from left to right."""
    middle = np.array([(low + high) / 2])
    shapes = (stop.opening, *stop.obscurations)
    curves = [curve for shape in shapes for curve in _curves_at(shape, float(middle[0]))]
    curves.sort(key=lambda curve: float(curve(middle)[0]))
    found: list[tuple[Curve, Curve]] = []
    for left, right in pairwise(curves):
        x = (left(middle) + right(middle)) / 2
        is_open = stop.opening.contains(middle, x)[0] and not any(
            shape.contains(middle, x)[0] for shape in stop.obscurations
        )
        if is_open:
            found.append((left, right))
    return tuple(found)


def _curves_at(shape: Shape, y: float) -> Iterator[Curve]:
    """Yield the pieces of a shape's boundary that a row at height y crosses."""
    if isinstance(shape, Circle):
        if abs(y - shape.centre[0]) < shape.radius:
            yield partial(_half_circle, shape, -1.0)
            yield partial(_half_circle, shape, 1.0)
        return
    for start, end in shape.edges:
        if (start[0] > y) != (end[0] > y):
            yield partial(_straight_edge, start, end)


def _half_circle(circle: Circle, side: float, y: Array) -> Array:
    (cy, cx), radius = circle.centre, circle.radius
    # The product keeps the digits of rows near the top and the bottom.
    below, above = radius - (y - cy), radius + (y - cy)
    return np.asarray(cx + side * np.sqrt(np.maximum(below * above, 0.0)))


def _straight_edge(start: Point, end: Point, y: Array) -> Array:
    (y0, x0), (y1, x1) = start, end
    return np.asarray(x0 + (y - y0) * ((x1 - x0) / (y1 - y0)))
