"""The share of grid cells, and the parts of circles, that a stop leaves open."""

from __future__ import annotations

import math
from itertools import combinations, pairwise

import numpy as np
import torch
from numpy.typing import NDArray

from optics.camera.stop import NEGLIGIBLE, Array, Circle, Piece, Point, Polygon, Shape, Stop
from optics.gauss_legendre import gauss_legendre
from optics.plane import Plane

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
        # The edges of the cells along y and x.
        lines = [
            ((np.arange(n + 1, dtype=np.float64) - n // 2 - 0.5) * p + float(c)) / radius
            for n, p, c in zip(plane.shape, plane.pitch, plane.centre, strict=True)
        ]
        steps = [
            _integrate_along_piece(piece, loop.sign, lines)
            for loop in stop.loops
            for piece in loop.pieces
        ]
        parts = [np.concatenate(part) for part in zip(*steps, strict=True)]
        order = np.argsort(parts[0], kind="stable")
        self._row, self._column, self._strip, self._step, self._sweep = (
            part[order] for part in parts
        )
        self._radius, self._shape = radius, plane.shape

    def open_share(self, rows: slice, columns: slice) -> torch.Tensor:
        """Return the open share of each cell in these rows and columns, float64."""
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

        A boundary point at b radii from the axis moves by b when the radius grows by one metre. The
        area that an element of the boundary sweeps is the component of b along the outward normal
        times the element's length, which is x dy - y dx.
        """
        rate = np.zeros(self._shape)
        here = (self._column >= 0) & (self._column < self._shape[1])
        np.add.at(rate, (self._row[here], self._column[here]), self._sweep[here])
        return torch.from_numpy(rate / (self._pitch[0] * self._pitch[1] * self._radius))


def _integrate_along_piece(
    piece: Piece, sign: int, lines: list[Array]
) -> tuple[NDArray[np.int64], NDArray[np.int64], Array, Array, Array]:
    """Divide a piece of a boundary at the grid's lines and integrate over each step.

    Returns each step's row and column, and the integrals of (x - left side of the cell) dy, of dy,
    and of x dy - y dx. A step beyond the grid's right side has the column after the last.
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


_FEW_EDGES = 32  # edges of a polygon up to which plain Python is as quick; chosen

Interval = tuple[float, float]
"""First and last angle of an arc, in radians from x towards y; the first is in [0, 2 pi)."""

_FULL_CIRCLE: Interval = (0.0, 2 * math.pi)


def open_arcs(stop: Stop, r: float) -> list[Interval]:
    """Return the arcs of the circle of radius r that a stop leaves open; r in stop radii."""
    found = _arcs_inside_shape(stop.opening, r)
    for shape in stop.obscurations:
        for low, high in _arcs_inside_shape(shape, r):
            found = [
                part
                for first, last in found
                for part in ((first, min(last, low)), (max(first, high), last))
                if part[1] - part[0] > NEGLIGIBLE
            ]
    if len(found) < 2 or found[0][0] > 0 or found[-1][1] < _FULL_CIRCLE[1]:
        return found
    # The last arc and the first meet at the angle 0.
    return [*found[1:-1], (found[-1][0], found[0][1] + 2 * math.pi)]


def _arcs_inside_shape(shape: Shape, r: float) -> list[Interval]:
    if isinstance(shape, Circle):
        return _arcs_inside_circle(shape, r)
    if len(shape.edges) > _FEW_EDGES and shape.is_star:
        return _arcs_inside_star(shape, r)
    cuts = [
        math.atan2(y, x) % (2 * math.pi)
        for p, q in shape.edges
        for y, x in _edge_circle_intersections((0.0, 0.0), r * r, p, q)
    ]
    ends = [0.0, *sorted(cuts), 2 * math.pi]
    return _merge_touching_arcs(
        [(a, b) for a, b in pairwise(ends) if _contains_point(shape, r, (a + b) / 2)]
    )


def _arcs_inside_star(polygon: Polygon, r: float) -> list[Interval]:
    """Return the arcs of a circle inside a polygon whose corners turn about the axis.

    In each corner's sector the outline is one edge, so that thousands of edges are quickly tried.
    """
    p = np.asarray(polygon.corners)
    q = np.roll(p, -1, axis=0)
    along, square = q - p, (p * p).sum(1)
    a, b = (along * along).sum(1), (along * p).sum(1)
    root = np.sqrt(np.maximum(b * b - a * (square - r * r), 0.0))
    found = [(-b + side * root) / a for side in (-1.0, 1.0)]
    crossed = [(root > 0) & (t >= 0) & (t <= 1) for t in found]
    places = np.concatenate(
        [(p + t[:, None] * along)[which] for t, which in zip(found, crossed, strict=True)]
    )
    cuts = np.sort(np.arctan2(places[:, 0], places[:, 1]) % (2 * math.pi))
    ends = np.concatenate(([0.0], cuts, [2 * math.pi]))
    middle = (ends[:-1] + ends[1:]) / 2
    corner = np.arctan2(p[:, 0], p[:, 1])
    order = np.argsort(corner)
    edge = order[np.searchsorted(corner[order], (middle + math.pi) % (2 * math.pi) - math.pi) - 1]
    # On the left of the edge that stands in its sector.
    y, x = r * np.sin(middle) - p[edge, 0], r * np.cos(middle) - p[edge, 1]
    inside = along[edge, 1] * y - along[edge, 0] * x > 0
    return _merge_touching_arcs(
        list(zip(ends[:-1][inside].tolist(), ends[1:][inside].tolist(), strict=True))
    )


def _contains_point(polygon: Polygon, r: float, angle: float) -> bool:
    """Tell whether a polygon contains a point of polar coordinates.

    `Polygon.contains` is slow for single points, and this may be called a million times.
    """
    y, x = r * math.sin(angle), r * math.cos(angle)
    inside = False
    for (y0, x0), (y1, x1) in polygon.edges:
        if (y0 > y) != (y1 > y) and x < x0 + (y - y0) * (x1 - x0) / (y1 - y0):
            inside = not inside
    return inside


def _merge_touching_arcs(arcs: list[Interval]) -> list[Interval]:
    kept: list[Interval] = []
    for first, last in arcs:
        if kept and first - kept[-1][1] <= 0:
            kept[-1] = (kept[-1][0], last)
        elif last > first:
            kept.append((first, last))
    return kept


def _arcs_inside_circle(circle: Circle, r: float) -> list[Interval]:
    away = math.hypot(*circle.centre)
    if r + away <= circle.radius:
        return [_FULL_CIRCLE]
    if abs(r - away) >= circle.radius:
        return []
    towards = math.atan2(*circle.centre)
    half = math.acos((r * r + away * away - circle.radius**2) / (2 * r * away))
    first = (towards - half) % (2 * math.pi)
    last = first + 2 * half
    if last <= 2 * math.pi:
        return [(first, last)]
    return [(0.0, last - 2 * math.pi), (first, 2 * math.pi)]


def break_radii(stop: Stop) -> list[float]:
    """Return the radii, in rising order, between which the open arcs change smoothly."""
    shapes: tuple[Shape, ...] = (stop.opening, *stop.obscurations)
    found = [r for shape in shapes for r in _critical_radii(shape)]
    found += [
        math.hypot(y, x) for a, b in combinations(shapes, 2) for y, x in outline_intersections(a, b)
    ]
    farthest = max(_critical_radii(stop.opening))
    kept = [0.0]
    for r in sorted(r for r in found if r < farthest - NEGLIGIBLE):
        if r > kept[-1] + NEGLIGIBLE:
            kept.append(r)
    return [*kept, farthest]


def _critical_radii(shape: Shape) -> list[float]:
    """Return the radii of a shape's corners, and where its edges are tangent to a circle.

    These circles stand around the axis. A disc has the radii of its nearest and farthest point.
    """
    if isinstance(shape, Circle):
        away = math.hypot(*shape.centre)
        return [abs(shape.radius - away), shape.radius + away]
    found = [math.hypot(*corner) for corner in shape.corners]
    for p, q in shape.edges:
        dy, dx = q[0] - p[0], q[1] - p[1]
        t = -(p[0] * dy + p[1] * dx) / (dy * dy + dx * dx)
        if 0 < t < 1:
            found.append(math.hypot(p[0] + t * dy, p[1] + t * dx))
    return found


def outline_intersections(a: Shape, b: Shape) -> list[Point]:
    """Return the points where the outlines of two shapes cross."""
    if isinstance(a, Circle) and isinstance(b, Circle):
        return _circle_intersections(a, b)
    if isinstance(a, Polygon) and isinstance(b, Polygon):
        return [m for p, q in a.edges for r, s in b.edges for m in _edge_intersections(p, q, r, s)]
    if isinstance(a, Polygon):
        return outline_intersections(b, a)
    circle, polygon = a, b
    assert isinstance(polygon, Polygon)
    return [
        m
        for p, q in polygon.edges
        for m in _edge_circle_intersections(circle.centre, circle.radius**2, p, q)
    ]


def _circle_intersections(a: Circle, b: Circle) -> list[Point]:
    dy, dx = b.centre[0] - a.centre[0], b.centre[1] - a.centre[1]
    distance = math.hypot(dy, dx)
    if not abs(a.radius - b.radius) < distance < a.radius + b.radius:
        return []
    along = (distance**2 + a.radius**2 - b.radius**2) / (2 * distance)
    across = math.sqrt(max(a.radius**2 - along**2, 0.0))
    y, x = dy / distance, dx / distance
    return [
        (a.centre[0] + along * y + side * x, a.centre[1] + along * x - side * y)
        for side in (across, -across)
    ]


def _edge_circle_intersections(centre: Point, square: float, p: Point, q: Point) -> list[Point]:
    """Return the points where an edge from p to q crosses a circle.

    square: the circle's squared radius.
    """
    (cy, cx), dy, dx = centre, q[0] - p[0], q[1] - p[1]
    y, x = p[0] - cy, p[1] - cx
    a, b = dy * dy + dx * dx, y * dy + x * dx
    root = b * b - a * (y * y + x * x - square)
    if root <= 0:
        return []
    parameters = ((-b - math.sqrt(root)) / a, (-b + math.sqrt(root)) / a)
    return [(p[0] + t * dy, p[1] + t * dx) for t in parameters if 0 <= t <= 1]


def _edge_intersections(p: Point, q: Point, r: Point, s: Point) -> list[Point]:
    dy, dx, ey, ex = q[0] - p[0], q[1] - p[1], s[0] - r[0], s[1] - r[1]
    turn = dx * ey - dy * ex
    if turn == 0:
        return []
    t = ((r[1] - p[1]) * ey - (r[0] - p[0]) * ex) / turn
    u = ((r[1] - p[1]) * dy - (r[0] - p[0]) * dx) / turn
    return [(p[0] + t * dy, p[1] + t * dx)] if 0 <= t <= 1 and 0 <= u <= 1 else []
