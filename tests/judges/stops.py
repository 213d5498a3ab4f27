"""Stops, line by line: where a horizontal line is open, and an integral over all of them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import lru_cache
from itertools import combinations, pairwise, product

import numpy as np

from judges.sums import Array, gauss, node_count
from optics.camera.stop import Circle, Polygon, Stop
from optics.plane import Plane

Shape = Circle | Polygon
Interval = tuple[float, float]
Edge = tuple[tuple[float, float], tuple[float, float]]


def _chord(shape: Shape, y: float) -> Interval | None:
    """Where a horizontal line is inside a convex shape."""
    if isinstance(shape, Circle):
        half2 = shape.radius**2 - (y - shape.centre[0]) ** 2
        if half2 <= 0:
            return None
        return shape.centre[1] - math.sqrt(half2), shape.centre[1] + math.sqrt(half2)
    crossed = [
        x0 + (y - y0) / (y1 - y0) * (x1 - x0)
        for (y0, x0), (y1, x1) in shape.edges
        if (y0 > y) != (y1 > y)
    ]
    return (min(crossed), max(crossed)) if crossed else None


def _open(stop: Stop, y: float) -> list[Interval]:
    """Where a horizontal line is open: the opening's chord less those of what stands in it."""
    chord = _chord(stop.opening, y)
    free = [chord] if chord else []
    for shape in stop.obscurations:
        taken = _chord(shape, y)
        if taken:
            free = [
                part
                for low, high in free
                for part in ((low, min(high, taken[0])), (max(low, taken[1]), high))
                if part[1] > part[0]
            ]
    return free


def _breaks(stop: Stop, x: Sequence[float] = (), y: Sequence[float] = ()) -> Array:
    """Heights at which a boundary turns or meets another one: between them all is smooth.

    x, y: further lines to be met, as of a grid.
    """
    shapes = (stop.opening, *stop.obscurations)
    found = [-1.0, 1.0, *y]
    for shape in shapes:
        if isinstance(shape, Circle):
            found += [shape.centre[0] - shape.radius, shape.centre[0] + shape.radius]
        else:
            found += [height for height, _ in shape.corners]
    upright = [((-2.0, position), (2.0, position)) for position in x]
    edges = [edge for shape in shapes if isinstance(shape, Polygon) for edge in shape.edges]
    circles = [shape for shape in shapes if isinstance(shape, Circle)]
    for one, two in combinations(edges, 2):
        found += _lines_meet(one, two)
    for one, two in product(edges, upright):
        found += _lines_meet(one, two)
    for circle, edge in product(circles, edges + upright):
        found += _circle_meets(circle, edge)
    for a, b in combinations(circles, 2):
        found += _circle_meets(a, _chord_line(a, b))
    return np.unique(np.round([height for height in found if -1 <= height <= 1], 15))


def _lines_meet(one: Edge, two: Edge) -> list[float]:
    """The height at which two straight pieces cross."""
    (p, q), (r, s) = np.array(one), np.array(two)
    matrix = np.column_stack([q - p, r - s])
    if abs(np.linalg.det(matrix)) < 1e-14:
        return []
    a, b = np.linalg.solve(matrix, r - p)
    return [float((p + a * (q - p))[0])] if 0 <= a <= 1 and 0 <= b <= 1 else []


def _circle_meets(circle: Circle, edge: Edge) -> list[float]:
    """The heights at which a straight piece crosses a circle."""
    p, along = np.array(edge[0]), np.subtract(edge[1], edge[0])
    away = p - circle.centre
    roots = np.roots([along @ along, 2 * away @ along, away @ away - circle.radius**2])
    real = roots[np.abs(np.imag(roots)) < 1e-9].real
    return [float(p[0] + t * along[0]) for t in real if 0 <= t <= 1]


def _chord_line(a: Circle, b: Circle) -> Edge:
    """A piece of the straight line on which two circles meet."""
    p, q = np.array(a.centre), np.array(b.centre)
    d = float(np.linalg.norm(q - p))
    if d == 0:
        return (9.0, 9.0), (9.0, 10.0)
    towards = (q - p) / d
    middle = p + towards * (d**2 + a.radius**2 - b.radius**2) / (2 * d)
    across = 2 * np.array([-towards[1], towards[0]])
    (y0, x0), (y1, x1) = middle - across, middle + across
    return (y0, x0), (y1, x1)


def scan_lines(stop: Stop, slope: float) -> list[tuple[float, Array, Array]]:
    """Heights, positions and weights of an integral over a stop, in stop radii.

    Heights go as a cosine between the breaks, so that round ends are smooth in them.
    """
    lines = []
    for y, weight in _heights(_breaks(stop), slope):
        for left, right in _open(stop, y):
            # Lines of about a length share their nodes: making them takes longest.
            inner, share = gauss(16 * math.ceil(node_count(right - left, slope) / 16))
            x = (left + right) / 2 + (right - left) / 2 * inner
            lines.append((y, x, weight * share * (right - left) / 2))
    return lines


def _heights(breaks: Array, slope: float) -> Iterator[tuple[float, float]]:
    """Heights and their weights between breaks."""
    for low, high in pairwise(breaks):
        middle, half = (low + high) / 2, (high - low) / 2
        if half < 1e-13:
            continue
        nodes, weights = gauss(node_count(2 * half, slope))
        angle = np.pi / 2 * (nodes + 1)
        yield from zip(
            middle - half * np.cos(angle), weights * np.pi / 2 * np.sin(angle) * half, strict=True
        )


def open_area(stop: Stop) -> float:
    """Gauss-Legendre along the lines that a stop leaves open"""
    return float(sum(w.sum() for _, _, w in scan_lines(stop, 0.0)))


def covered(stop: Stop, radius: float, plane: Plane) -> Array:
    """Gauss-Legendre along the lines that the stop leaves open in each cell"""
    return _covered(stop, radius, plane).copy()


@lru_cache(maxsize=32)
def _covered(stop: Stop, radius: float, plane: Plane) -> Array:
    (rows, columns), (py, px) = plane.shape, (p / radius for p in plane.pitch)
    y, x = (
        (np.arange(n + 1) - n // 2 - 0.5) * p + float(c) / radius
        for n, p, c in zip(plane.shape, (py, px), plane.centre, strict=True)
    )
    area = np.zeros((rows, columns))
    for height, weight in _heights(_breaks(stop, tuple(x), tuple(y)), 0.0):
        row = int(np.searchsorted(y, height)) - 1
        if 0 <= row < rows:
            for low, high in _open(stop, height):
                area[row] += weight * np.clip(
                    np.minimum(high, x[1:]) - np.maximum(low, x[:-1]), 0, None
                )
    return np.asarray(area / (py * px))
