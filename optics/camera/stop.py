"""The open area of a stop: a circle or polygon, less obscurations.

Lengths are in units of the stop's radius, which is the radius of the circle around it. Every open
area is described by its boundary alone. Its area and its share of each cell of a grid follow from
the boundary exactly, by Green's theorem, so that nothing is rasterised.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np
from numpy.typing import NDArray

from optics.gauss_legendre import gauss_legendre

Point = tuple[float, float]
Array = NDArray[np.float64]

NEGLIGIBLE = 1e-12
"""Areas and lengths below this, in units of the stop's radius, count as rounding errors."""

_MOST_CORNERS = 5000  # corners of a polygon, whose edges are compared in half a second; chosen


@dataclass(frozen=True)
class Circle:
    """A disc of an opening or an obscuration; radius and centre (y, x) in stop radii."""

    radius: float = 1.0
    centre: Point = (0.0, 0.0)

    def __post_init__(self) -> None:
        if not 0 < self.radius < math.inf:
            raise ValueError(f"radius is {self.radius:g}; it must be positive and finite")
        if not np.isfinite(self.centre).all():
            raise ValueError(f"centre is {self.centre}; it must be finite")

    @property
    def extent(self) -> tuple[Point, Point]:
        """The lowest and the highest y and x."""
        (y, x), r = self.centre, self.radius
        return (y - r, x - r), (y + r, x + r)

    def contains(self, y: Array, x: Array) -> NDArray[np.bool_]:
        """Tell which points lie in the disc."""
        return np.hypot(y - self.centre[0], x - self.centre[1]) <= self.radius


@dataclass(frozen=True)
class Polygon:
    """A simple polygon; corners (y, x) in stop radii, in either order."""

    corners: tuple[Point, ...]

    def __post_init__(self) -> None:
        if len(self.corners) < 3:
            raise ValueError(f"a polygon has {len(self.corners)} corners; give three or more")
        if len(self.corners) > _MOST_CORNERS:
            raise ValueError(
                f"a polygon has {len(self.corners)} corners, each of which is compared with all "
                f"others; give {_MOST_CORNERS} at most"
            )
        if not np.isfinite(self.corners).all():
            raise ValueError("a polygon's corners must be finite numbers")
        if _crosses_itself(self.corners):
            raise ValueError("a polygon crosses itself; give its corners in order")
        area = _shoelace(self.corners)
        if abs(area) < NEGLIGIBLE:
            raise ValueError("a polygon's corners lie in a line; it has no area")
        if area < 0:
            object.__setattr__(self, "corners", tuple(reversed(self.corners)))

    @functools.cached_property
    def edges(self) -> list[tuple[Point, Point]]:
        return list(zip(self.corners, self.corners[1:] + self.corners[:1], strict=True))

    @functools.cached_property
    def is_star(self) -> bool:
        """Whether the whole outline is seen from the axis."""
        p = np.asarray(self.corners)
        q = np.roll(p, -1, axis=0)
        turns = np.arctan2(p[:, 1] * q[:, 0] - p[:, 0] * q[:, 1], (p * q).sum(1))
        return bool((turns > 0).all() and abs(turns.sum() - 2 * math.pi) < 1e-6)

    @property
    def is_convex(self) -> bool:
        return all(
            _cross(a, b, c) >= -NEGLIGIBLE
            for (a, b), (_, c) in zip(self.edges, self.edges[1:] + self.edges[:1], strict=True)
        )

    @property
    def extent(self) -> tuple[Point, Point]:
        """The lowest and the highest y and x."""
        y, x = zip(*self.corners, strict=True)
        return (min(y), min(x)), (max(y), max(x))

    def contains(self, y: Array, x: Array) -> NDArray[np.bool_]:
        """Tell which points lie in the polygon."""
        inside = np.zeros(np.broadcast_shapes(np.shape(y), np.shape(x)), dtype=bool)
        for (y0, x0), (y1, x1) in self.edges:
            crosses = (y0 > y) != (y1 > y)
            with np.errstate(divide="ignore", invalid="ignore"):
                inside ^= crosses & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
        return inside


Shape = Circle | Polygon


def rectangle(height: float, width: float, centre: Point = (0.0, 0.0)) -> Polygon:
    """Make an upright rectangle; lengths in stop radii."""
    (y, x), v, u = centre, height / 2, width / 2
    return Polygon(((y - v, x - u), (y - v, x + u), (y + v, x + u), (y + v, x - u)))


def regular_polygon(sides: int, radius: float = 1.0, turn: float = 0.0) -> Polygon:
    """Make the opening between straight blades: a regular polygon.

    radius: of the circle through its corners, in stop radii. turn: rotation in radians.
    """
    if not 3 <= sides <= _MOST_CORNERS:
        raise ValueError(
            f"sides is {sides}; an opening has three or more, and {_MOST_CORNERS} at most: a "
            "circle has any number"
        )
    angles = turn + 2 * math.pi / sides * np.arange(sides)
    return Polygon(tuple((radius * math.sin(a), radius * math.cos(a)) for a in angles))


@dataclass(frozen=True)
class Segment:
    """A straight piece of a boundary."""

    start: Point
    end: Point

    def points(self, t: Array) -> tuple[Array, Array]:
        """Return the points (y, x) at parameters t, from 0 to 1."""
        (y0, x0), (y1, x1) = self.start, self.end
        return y0 + t * (y1 - y0), x0 + t * (x1 - x0)

    def velocity(self, t: Array) -> tuple[Array, Array]:
        (y0, x0), (y1, x1) = self.start, self.end
        return np.full_like(t, y1 - y0), np.full_like(t, x1 - x0)

    def crossings(self, axis: int, level: Array) -> Array:
        """Return the parameters t at which the piece crosses levels of y (axis 0) or x (axis 1)."""
        low, high = self.start[axis], self.end[axis]
        if low == high:
            return np.empty(0)
        t = (level - low) / (high - low)
        return np.asarray(t[(t > 0) & (t < 1)])


@dataclass(frozen=True)
class Arc:
    """A circular piece of a boundary, between two angles in radians from x towards y."""

    centre: Point
    radius: float
    first: float
    last: float

    def points(self, t: Array) -> tuple[Array, Array]:
        angle = self.first + t * (self.last - self.first)
        y, x = self.centre
        return y + self.radius * np.sin(angle), x + self.radius * np.cos(angle)

    def velocity(self, t: Array) -> tuple[Array, Array]:
        angle, turn = self.first + t * (self.last - self.first), self.last - self.first
        return self.radius * turn * np.cos(angle), -self.radius * turn * np.sin(angle)

    def crossings(self, axis: int, level: Array) -> Array:
        share = (level - self.centre[axis]) / self.radius
        share = share[np.abs(share) < 1]
        if axis == 0:
            angles = np.concatenate([np.arcsin(share), math.pi - np.arcsin(share)])
        else:
            angles = np.concatenate([np.arccos(share), -np.arccos(share)])
        low, turn = min(self.first, self.last), abs(self.last - self.first)
        away = np.mod(angles - low, 2 * math.pi)
        away = away[(away > 0) & (away < turn)] / turn
        return away if self.last > self.first else 1 - away


Piece = Segment | Arc


@dataclass(frozen=True)
class Loop:
    """A closed boundary; the area inside it counts `sign` times."""

    pieces: tuple[Piece, ...]
    sign: int = 1

    @property
    def area(self) -> float:
        """The signed area inside, in square stop radii, by Green's theorem.

        24 nodes make it exact to rounding, for arcs and segments.
        """
        nodes, weights = gauss_legendre(24)
        t, total = (nodes + 1) / 2, 0.0
        for piece in self.pieces:
            (y, x), (dy, dx) = piece.points(t), piece.velocity(t)
            total += float(np.sum(weights / 2 * (x * dy - y * dx)) / 2)
        return self.sign * total


@dataclass(frozen=True)
class Stop:
    """An aperture stop: an opening and its obscurations; lengths in stop radii.

    Obscurations may reach beyond the opening's edge and overlap in pairs, as the vanes of a
    spider do. Raises ValueError where three overlap, or nothing stays open.
    """

    opening: Shape = Circle()
    obscurations: tuple[Shape, ...] = ()

    def __post_init__(self) -> None:
        if isinstance(self.opening, Circle):
            reach = math.hypot(*self.opening.centre) + self.opening.radius
        else:
            reach = np.hypot(*np.transpose(self.opening.corners)).max()
        if reach > 1 + 1e-9:
            raise ValueError("the opening reaches beyond the stop's radius, 1; scale it down")
        if any(self._overlap_in_opening(*three) for three in _near_triples(self.obscurations)):
            raise ValueError(
                "three obscurations overlap; end vanes where others begin, or draw them as one"
            )
        if self.area <= NEGLIGIBLE:
            raise ValueError("the obscurations close the stop: no light passes")

    @functools.cached_property
    def loops(self) -> tuple[Loop, ...]:
        """The boundary: the opening's, less each obscuration, plus overlaps of pairs.

        An overlap is added because both obscurations subtract it.
        """
        found: list[tuple[int, Loop | None]] = [(1, _boundary(self.opening))]
        found += [(-1, _intersection_loop(self.opening, shape)) for shape in self.obscurations]
        found += [(1, self._pair_overlap(a, b)) for a, b in combinations(self.obscurations, 2)]
        return tuple(Loop(loop.pieces, sign) for sign, loop in found if loop is not None)

    def _overlap_in_opening(self, a: Shape, b: Shape, c: Shape) -> bool:
        """Tell whether three obscurations overlap inside the opening.

        Touching isn't overlapping: vanes that end where others begin share corners.
        """
        a, b, c = sorted((a, b, c), key=lambda shape: isinstance(shape, Circle))
        if isinstance(a, Polygon) and isinstance(b, Polygon):
            both = _clip_polygon(a, b)
            if both is not None and isinstance(c, Polygon):
                both, c = _clip_polygon(both, c), self.opening
            if both is None:
                return False
            if c == self.opening or _lies_within(c, self.opening):
                whole = _intersection_loop(c, both)
                return whole is not None and whole.area > NEGLIGIBLE
        # The overlap of two circles, or of a circle that the opening's edge cuts, is found by
        # sampling.
        grid = (np.arange(800) + 0.5) / 400 - 1
        y, x = grid[:, None], grid[None, :]
        inside = (shape.contains(y, x) for shape in (self.opening, a, b, c))
        return bool(np.logical_and.reduce(list(inside)).any())

    def _pair_overlap(self, a: Shape, b: Shape) -> Loop | None:
        if _intersection_loop(a, b) is None:
            return None
        if _lies_within(a, self.opening) or _lies_within(b, self.opening):
            return _intersection_loop(a, b)
        if isinstance(a, Polygon) and isinstance(b, Polygon):
            both = _clip_polygon(a, b)
            return _intersection_loop(self.opening, both) if both else None
        raise ValueError("two obscurations overlap beyond the opening; draw them as one polygon")

    @property
    def area(self) -> float:
        """The open area in square stop radii."""
        return sum(loop.area for loop in self.loops)

    @property
    def annulus_radii(self) -> tuple[float, float] | None:
        """The inner and outer radius of a disc or an annulus, else None."""
        if not isinstance(self.opening, Circle) or any(self.opening.centre):
            return None
        if not self.obscurations:
            return 0.0, self.opening.radius
        first = self.obscurations[0]
        if len(self.obscurations) > 1 or not isinstance(first, Circle) or any(first.centre):
            return None
        return first.radius, self.opening.radius

    @property
    def rectangle_bounds(self) -> tuple[float, float, float, float] | None:
        """The limits (low y, high y, low x, high x) of an upright rectangle, else None."""
        opening = self.opening
        if self.obscurations or isinstance(opening, Circle) or len(opening.corners) != 4:
            return None
        if any(a[0] != b[0] and a[1] != b[1] for a, b in opening.edges):
            return None
        (y0, x0), (y1, x1) = opening.extent
        return y0, y1, x0, x1


def _near_triples(shapes: Sequence[Shape]) -> Iterator[tuple[Shape, ...]]:
    """Yield the triples of shapes of which each two may overlap, by their extents."""
    low, high = (np.array([one.extent[end] for one in shapes]).reshape(-1, 2) for end in (0, 1))
    near: NDArray[np.bool_] = np.all((low[:, None] <= high) & (low <= high[:, None]), axis=-1)
    for i, j in np.argwhere(np.triu(near, 1)).tolist():
        for k in np.flatnonzero(near[i] & near[j]).tolist():
            if k > j:
                yield shapes[i], shapes[j], shapes[k]


def _shoelace(corners: Sequence[Point]) -> float:
    turned = (*corners[1:], corners[0])
    return 0.5 * sum(x0 * y1 - x1 * y0 for (y0, x0), (y1, x1) in zip(corners, turned, strict=True))


def _cross(a: Point, b: Point, c: Point) -> float:
    """Return the cross product of the vectors ab and ac, positive for a turn from x towards y."""
    return (b[1] - a[1]) * (c[0] - a[0]) - (b[0] - a[0]) * (c[1] - a[1])


def _crosses_itself(corners: Sequence[Point]) -> bool:
    start, count = np.array(corners, dtype=np.float64), len(corners)
    end = np.roll(start, -1, axis=0)
    for i in range(count - 2):
        # Edges that share a corner don't cross; the last one shares one with the first.
        others = slice(i + 2, count - (i == 0))
        a, b, c, d = start[i], end[i], start[others], end[others]
        if (_on_both_sides(a, b, c, d) & _on_both_sides(c, d, a, b)).any():
            return True
    return False


def _on_both_sides(start: Array, end: Array, c: Array, d: Array) -> NDArray[np.bool_]:
    """Tell whether c and d, points (..., 2), lie on different sides of the line through an edge.

    The answer is no if either lies on the line up to rounding.
    """
    (y, x), (height, width) = start.T, (end - start).T
    sides = [width * (at.T[0] - y) - height * (at.T[1] - x) for at in (c, d)]
    low, high = np.minimum(*sides), np.maximum(*sides)
    return np.asarray((low < -NEGLIGIBLE) & (high > NEGLIGIBLE))


def _boundary(shape: Shape) -> Loop:
    if isinstance(shape, Circle):
        return Loop((Arc(shape.centre, shape.radius, 0.0, 2 * math.pi),))
    return Loop(tuple(Segment(a, b) for a, b in shape.edges))


def _lies_within(inner: Shape, outer: Shape) -> bool:
    if isinstance(outer, Circle) and isinstance(inner, Circle):
        return math.dist(inner.centre, outer.centre) + inner.radius <= outer.radius
    if isinstance(outer, Circle):
        y, x = np.transpose(inner.corners)  # type: ignore[union-attr]
        return bool(outer.contains(y, x).all())
    if isinstance(inner, Circle):
        y, x = np.transpose([inner.centre])
        return bool(outer.contains(y, x)[0]) and all(
            _distance_to_segment(inner.centre, a, b) >= inner.radius for a, b in outer.edges
        )
    both = _intersection_loop(outer, inner)
    return abs((both.area if both else 0.0) - _shoelace(inner.corners)) < NEGLIGIBLE


def _distance_to_segment(p: Point, a: Point, b: Point) -> float:
    """Return the distance from a point to the straight edge from a to b."""
    along = np.subtract(b, a)
    t = float(np.clip(np.dot(np.subtract(p, a), along) / np.dot(along, along), 0, 1))
    return math.dist(p, (a[0] + t * along[0], a[1] + t * along[1]))


def _intersection_loop(a: Shape, b: Shape) -> Loop | None:
    """Return the boundary of the overlap of two shapes, or None if it is empty."""
    if isinstance(a, Circle) and isinstance(b, Circle):
        return _circle_intersection(a, b)
    if isinstance(a, Circle):
        return _circle_polygon_intersection(a, b)  # type: ignore[arg-type]
    if isinstance(b, Circle):
        return _circle_polygon_intersection(b, a)
    both = _clip_polygon(a, b)
    return _boundary(both) if both else None


def _circle_intersection(a: Circle, b: Circle) -> Loop | None:
    distance = math.dist(a.centre, b.centre)
    if distance >= a.radius + b.radius:
        return None
    if distance <= abs(a.radius - b.radius):
        return _boundary(min(a, b, key=lambda c: c.radius))
    arcs = []
    for one, other in ((a, b), (b, a)):
        towards = math.atan2(other.centre[0] - one.centre[0], other.centre[1] - one.centre[1])
        reach = math.acos(
            (distance**2 + one.radius**2 - other.radius**2) / (2 * distance * one.radius)
        )
        arcs.append(Arc(one.centre, one.radius, towards - reach, towards + reach))
    return Loop(tuple(arcs))


def _circle_polygon_intersection(circle: Circle, polygon: Polygon) -> Loop | None:
    """Return the boundary of the overlap of a circle and a polygon.

    Edges inside the circle are kept, and one outside is replaced by the arc that it hides, seen
    from the circle's centre. Each sweeps a signed area around the centre, so that the sum is right
    for every simple polygon.
    """
    pieces: list[Piece] = []
    cy, cx = circle.centre
    for a, b in polygon.edges:
        edge = Segment(a, b)
        cuts = [0.0, *_circle_crossings(circle, edge), 1.0]
        for low, high in pairwise(cuts):
            y, x = edge.points(np.array([low, (low + high) / 2, high]))
            p, middle, q = zip(y.tolist(), x.tolist(), strict=True)
            # An edge that only touches the circle in its middle counts as outside.
            if math.dist(middle, circle.centre) < circle.radius - NEGLIGIBLE:
                pieces.append(Segment(p, q))
                continue
            from_p, from_q = (math.atan2(at[0] - cy, at[1] - cx) for at in (p, q))
            turn = math.remainder(from_q - from_p, 2 * math.pi)
            pieces.append(Arc(circle.centre, circle.radius, from_p, from_p + turn))
    loop = Loop(tuple(pieces))
    return loop if abs(loop.area) > NEGLIGIBLE else None


def _circle_crossings(circle: Circle, edge: Segment) -> list[float]:
    """Return the parameters t, in order, at which a straight edge crosses a circle."""
    start, along = np.subtract(edge.start, circle.centre), np.subtract(edge.end, edge.start)
    a, b = float(along @ along), float(start @ along)
    root = b * b - a * (float(start @ start) - circle.radius**2)
    if root <= 0:
        return []
    found = [(-b - math.sqrt(root)) / a, (-b + math.sqrt(root)) / a]
    return [t for t in found if 0 < t < 1]


def _clip_polygon(a: Polygon, b: Polygon) -> Polygon | None:
    """Intersect two polygons, one of which is convex (Sutherland and Hodgman 1974)."""
    if not a.is_convex:
        a, b = b, a
    if not a.is_convex:
        raise ValueError("neither the opening nor the obscuration is convex; draw them as one")
    corners: Sequence[Point] = b.corners
    for start, end in a.edges:
        corners = _clip_by_line(corners, start, end)
    if len(corners) < 3 or abs(_shoelace(corners)) < NEGLIGIBLE:
        return None
    return Polygon(tuple(corners))


def _clip_by_line(corners: Sequence[Point], start: Point, end: Point) -> list[Point]:
    kept: list[Point] = []
    for p, q in zip(corners, (*corners[1:], *corners[:1]), strict=True):
        at_p, at_q = _cross(start, end, p), _cross(start, end, q)
        if at_p >= 0:
            kept.append(p)
        if (at_p > 0 > at_q) or (at_p < 0 < at_q):
            t = at_p / (at_p - at_q)
            kept.append((p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])))
    unlike: list[Point] = []
    for corner in kept:
        if not unlike or math.dist(corner, unlike[-1]) > NEGLIGIBLE:
            unlike.append(corner)
    closed = len(unlike) > 1 and math.dist(unlike[0], unlike[-1]) <= NEGLIGIBLE
    return unlike[:-1] if closed else unlike
