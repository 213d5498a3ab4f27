"""The PSF of a lens by direct quadrature over lines across its stop.

This is the slow reference of the fast PSF engines, and shares no code with them. The stop is cut
into horizontal lines. On each line the open intervals follow from the shapes themselves, and
Gauss-Legendre nodes fill them. The heights of the lines lie between all corners, crossings and
extremes of the shapes. They are denser at the ends of each stretch, so that round ends cost no
accuracy. Phases and Zernike polynomials have their own code here.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.special import roots_legendre

from optics.camera import Lens
from optics.camera.stop import Circle, Polygon, Shape, Stop
from optics.plane import Plane
from optics.progress import Progress

Array = NDArray[np.float64]
Interval = tuple[float, float]

_EXTRA_NODES = 40
"""Nodes of an interval, and lines of a stretch, beyond those that the phase slope asks for."""

NODE_MARGIN = 1.3
"""Factor by which nodes are denser than the phase slope asks for."""


@dataclass(frozen=True)
class StopLine:
    """A horizontal line across a stop: height, weight in an integral over heights, open intervals.

    Lengths are in stop radii.
    """

    height: float
    weight: float
    open: list[Interval]


def lens_psf(
    lens: Lens, distance: float, wavelength: float, pixels: Plane, progress: Progress | None = None
) -> Array:
    """Return a point's light on each sample of a plane: its density times the area of a pixel."""
    y, x = (sample_positions(pixels, axis) for axis in (0, 1))
    density = lens_psf_density(lens, distance, wavelength, y, x, progress)
    return density * pixels.pitch[0] * pixels.pitch[1]


def lens_psf_density(
    lens: Lens,
    distance: float,
    wavelength: float,
    y: Array,
    x: Array,
    progress: Progress | None = None,
) -> Array:
    """Return the share of a point's light per square metre at y and x in metres, (y, x).

    The Fraunhofer integral over the stop (thesis Eq. 3.1) is summed directly along both axes.
    """
    radius, scale = lens.stop_diameter / 2, wavelength * lens.image_distance
    tilt = 2 * np.pi * radius / scale
    steepest = steepest_phase_slope(lens, distance, wavelength)
    farthest = math.hypot(float(np.abs(y).max()), float(np.abs(x).max()))
    slope = NODE_MARGIN * (steepest + tilt * farthest)
    lines = list(stop_lines(lens.stop, slope))
    field = np.zeros((y.size, x.size), dtype=np.complex128)
    area = 0.0
    for number, line in enumerate(lines):
        if progress is not None and number % 64 == 0:
            progress.report(number / len(lines), "the exact integral")
        parts = [_interval_rule(low, high, slope) for low, high in line.open]
        nodes, weights = (np.concatenate(part) for part in zip(*parts, strict=True))
        weights = line.weight * weights
        wave = weights * np.exp(1j * pupil_phase(lens, distance, wavelength, line.height, nodes))
        row = wave @ np.exp(-1j * tilt * np.outer(nodes, x))
        field += np.outer(np.exp(-1j * tilt * y * line.height), row)
        area += float(weights.sum())
    return np.asarray(radius**2 / (scale**2 * area) * np.abs(field) ** 2)


def node_count(lens: Lens, distance: float, wavelength: float, farthest: float) -> float:
    """Estimate how many nodes `lens_psf_density` takes, with the farthest sample in metres."""
    radius, scale = lens.stop_diameter / 2, wavelength * lens.image_distance
    slope = NODE_MARGIN * (
        steepest_phase_slope(lens, distance, wavelength) + 2 * np.pi * radius / scale * farthest
    )
    return (slope * np.pi / 4 + _EXTRA_NODES) * (slope / 2 + _EXTRA_NODES)


def sample_positions(plane: Plane, axis: int) -> Array:
    """Return a plane's sample positions along an axis, in metres."""
    index = np.arange(plane.shape[axis]) - plane.shape[axis] // 2
    return np.asarray(index * plane.pitch[axis] + float(plane.centre[axis]))


def stop_lines(stop: Stop, slope: float) -> Iterator[StopLine]:
    """Yield the lines across a stop whose weighted sum of integrals is that over the stop.

    slope: steepest phase slope, radians per stop radius.
    """
    for low, high in pairwise(break_heights(stop)):
        if high - low < 1e-13:
            continue
        # In t, with y = middle + half sin(t), the integrand is smooth even where the width of a
        # shape begins or ends as a square root.
        fastest = max((high - low) / 2, _interval_end_speed(stop, low, high))
        count = math.ceil(slope * fastest * np.pi / 4) + _EXTRA_NODES
        t, weight = _legendre(count)
        angles = t * np.pi / 2
        for angle, w in zip(angles, weight * np.pi / 2, strict=True):
            height = (low + high) / 2 + (high - low) / 2 * np.sin(angle)
            parts = open_intervals(stop, height)
            if parts:
                yield StopLine(float(height), w * (high - low) / 2 * np.cos(angle), parts)


def _interval_end_speed(stop: Stop, low: float, high: float) -> float:
    """Estimate how far ends of open intervals move along x per angle of the height, by samples.

    Ends on nearly horizontal edges move far in a small step of the angle.
    """
    angles = np.linspace(-np.pi / 2, np.pi / 2, 65)[1:-1]
    heights = (low + high) / 2 + (high - low) / 2 * np.sin(angles)
    ends = [np.array(open_intervals(stop, float(height))).ravel() for height in heights]
    moved = [float(np.abs(b - a).max()) for a, b in pairwise(ends) if a.size == b.size > 0]
    return 1.2 * max(moved, default=0.0) / float(angles[1] - angles[0])


@functools.lru_cache(maxsize=512)
def _legendre(count: int) -> tuple[Array, Array]:
    nodes, weights = roots_legendre(count)
    return nodes, weights


def _interval_rule(low: float, high: float, slope: float) -> tuple[Array, Array]:
    count = math.ceil(slope * (high - low) / 4 / 16) * 16 + _EXTRA_NODES
    t, w = _legendre(count)
    return (low + high) / 2 + (high - low) / 2 * t, (high - low) / 2 * w


def open_intervals(stop: Stop, height: float) -> list[Interval]:
    """Return a stop's open intervals on a horizontal line, in stop radii."""
    found = _intervals(stop.opening, height)
    for shape in stop.obscurations:
        for low, high in _intervals(shape, height):
            found = [
                part
                for a, b in found
                for part in ((a, min(b, low)), (max(a, high), b))
                if part[1] > part[0]
            ]
    return found


def _intervals(shape: Shape, height: float) -> list[Interval]:
    if isinstance(shape, Circle):
        away = height - shape.centre[0]
        if abs(away) >= shape.radius:
            return []
        half = math.sqrt((shape.radius - away) * (shape.radius + away))
        return [(shape.centre[1] - half, shape.centre[1] + half)]
    crossings = sorted(
        x0 + (height - y0) * (x1 - x0) / (y1 - y0)
        for (y0, x0), (y1, x1) in _edges(shape)
        if (y0 > height) != (y1 > height)
    )
    return list(zip(crossings[::2], crossings[1::2], strict=True))


def _edges(polygon: Polygon) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    corners = polygon.corners
    return list(zip(corners, (*corners[1:], corners[0]), strict=True))


def break_heights(stop: Stop) -> list[float]:
    """Return the heights at which open intervals begin, end or meet, in rising order."""
    shapes: Sequence[Shape] = (stop.opening, *stop.obscurations)
    found = [height for shape in shapes for height in _extremes(shape)]
    for a, b in combinations(shapes, 2):
        found += _outline_crossings(a, b)
    low, high = min(_extremes(stop.opening)), max(_extremes(stop.opening))
    return sorted({min(max(height, low), high) for height in found})


def vertical_line_crossings(stop: Stop, x: float) -> list[float]:
    """Return the heights at which outlines cross the vertical line at x, all in stop radii."""
    low, high = break_heights(stop)[0] - 1, break_heights(stop)[-1] + 1
    found: list[float] = []
    for shape in (stop.opening, *stop.obscurations):
        if isinstance(shape, Circle):
            found += _circle_segment_crossings(shape, (low, x), (high, x))
        else:
            found += [
                y for edge in _edges(shape) for y in _segment_crossings(*edge, (low, x), (high, x))
            ]
    return found


def _extremes(shape: Shape) -> list[float]:
    if isinstance(shape, Circle):
        return [shape.centre[0] - shape.radius, shape.centre[0] + shape.radius]
    return [y for y, _ in shape.corners]


def _outline_crossings(a: Shape, b: Shape) -> list[float]:
    """Return the heights at which two outlines cross."""
    if isinstance(a, Circle) and isinstance(b, Circle):
        return _circle_crossings(a, b)
    if isinstance(a, Circle) and isinstance(b, Polygon):
        return [y for edge in _edges(b) for y in _circle_segment_crossings(a, *edge)]
    if isinstance(b, Circle):
        return _outline_crossings(b, a)
    return [y for p in _edges(a) for q in _edges(b) for y in _segment_crossings(*p, *q)]  # type: ignore[arg-type]


def _circle_crossings(a: Circle, b: Circle) -> list[float]:
    y, x = b.centre[0] - a.centre[0], b.centre[1] - a.centre[1]
    d = math.hypot(y, x)
    if d == 0 or not abs(a.radius - b.radius) < d < a.radius + b.radius:
        return []
    along = (d * d + a.radius**2 - b.radius**2) / (2 * d)
    across = math.sqrt(max(a.radius**2 - along**2, 0.0))
    return [a.centre[0] + (along * y + sign * across * x) / d for sign in (-1, 1)]


def _circle_segment_crossings(
    c: Circle, p: tuple[float, float], q: tuple[float, float]
) -> Iterable[float]:
    start, step = np.subtract(p, c.centre), np.subtract(q, p)
    roots = np.roots([step @ step, 2 * start @ step, start @ start - c.radius**2])
    return [p[0] + t.real * step[0] for t in roots if abs(t.imag) < 1e-12 and 0 <= t.real <= 1]


def _segment_crossings(
    p: tuple[float, float], q: tuple[float, float], r: tuple[float, float], s: tuple[float, float]
) -> list[float]:
    matrix = np.array([np.subtract(q, p), np.subtract(r, s)]).T
    if abs(np.linalg.det(matrix)) < 1e-14:
        return []
    t, u = np.linalg.solve(matrix, np.subtract(r, p))
    return [p[0] + t * (q[0] - p[0])] if 0 <= t <= 1 and 0 <= u <= 1 else []


def pupil_phase(lens: Lens, distance: float, wavelength: float, y: float, x: Array) -> Array:
    """Return the phase of defocus and aberrations at one height y and many x, in radians.

    Positions are in stop radii; distances, wavelength and aberrations are in metres.
    """
    rho2 = y * y + x * x
    r2 = rho2 * (lens.stop_diameter / 2) ** 2
    near, far = 1 / distance, 1 / lens.focus_distance
    if lens.kind == "thin":
        path = (near - far) * r2 / 2
    else:
        path = np.zeros_like(r2)
        for sign, v in ((1, near), (-1, far)):
            path = path + sign * r2 * v / (1 + np.sqrt(1 + r2 * v * v))
    angle = np.arctan2(y, x)
    for n, m, strength in lens.aberrations:
        path = path + strength * _zernike(n, m, np.sqrt(rho2), angle)
    return np.asarray(2 * np.pi / wavelength * path)


def _zernike(n: int, m: int, r: Array, angle: Array) -> Array:
    """Return a Zernike polynomial of rms 1, by factorials: accurate to about degree twenty."""
    k = abs(m)
    radial = sum(
        (-1) ** s
        * math.factorial(n - s)
        / (math.factorial(s) * math.factorial((n + k) // 2 - s) * math.factorial((n - k) // 2 - s))
        * r ** (n - 2 * s)
        for s in range((n - k) // 2 + 1)
    )
    turned = np.cos(k * angle) if m >= 0 else np.sin(k * angle)
    return np.asarray(math.sqrt((2 if m else 1) * (n + 1)) * radial * turned)


@functools.lru_cache(maxsize=64)
def steepest_phase_slope(lens: Lens, distance: float, wavelength: float) -> float:
    """Estimate the pupil phase's steepest slope from samples, in radians per stop radius."""
    found = 0.0
    x = np.linspace(-1, 1, 801)
    for y in np.linspace(-1, 1, 201):
        inside = np.abs(x) <= math.sqrt(max(1 - y * y, 0.0)) + 0.01
        line = pupil_phase(lens, distance, wavelength, float(y), x[inside])
        column = pupil_phase(lens, distance, wavelength, float(y) + 1e-4, x[inside])
        if line.size > 1:
            along = np.abs(np.diff(line)).max() / (x[1] - x[0])
            across = np.abs(column - line).max() / 1e-4
            found = max(found, math.hypot(along, across))
    return found


def open_area_shares(stop: Stop, radius: float, plane: Plane) -> Array:
    """Return the share of each sample's cell that a stop leaves open, (rows, columns), 0 to 1.

    It is within 1e-9 for stops of circles and straight edges. The stop's radius is in metres; a
    cell is as large as the pitch.
    """
    # The cells' edges, in stop radii.
    top, left = (
        np.append(middles - pitch / 2, middles[-1] + pitch / 2) / radius
        for pitch, middles in zip(
            plane.pitch, (sample_positions(plane, axis) for axis in (0, 1)), strict=True
        )
    )
    area = np.zeros(plane.shape)
    low, high = break_heights(stop)[0], break_heights(stop)[-1]
    met = [y for x in left for y in vertical_line_crossings(stop, float(x))]
    breaks = sorted({*break_heights(stop), *met, *(y for y in top if low < y < high)})
    # Twelve nodes between two break heights: there the open length is smooth in the angle below.
    nodes, weights = roots_legendre(12)
    angles = nodes * np.pi / 2
    for low, high in pairwise(breaks):
        if high - low < 1e-13:
            continue
        # The chord of a circle grows as the square root of the height above its lowest point,
        # which is smooth in the angle.
        heights = (low + high) / 2 + (high - low) / 2 * np.sin(angles)
        shares = weights * np.pi / 2 * (high - low) / 2 * np.cos(angles)
        row = int(np.searchsorted(top, (low + high) / 2)) - 1
        if 0 <= row < plane.shape[0]:
            for y, share in zip(heights, shares, strict=True):
                # The open length of a horizontal line in every cell.
                length = np.zeros(left.size - 1)
                for start, end in open_intervals(stop, float(y)):
                    length += np.clip(
                        np.minimum(end, left[1:]) - np.maximum(start, left[:-1]), 0, None
                    )
                area[row] += share * length
    return area * radius**2 / (plane.pitch[0] * plane.pitch[1])
