"""A point's light through a chain, summed over nodes in a stop of any shape, in numpy.

Rows of the stop are clustered at the heights where its outline has corners, or turns; so the sum
converges to rounding, also in dark windows.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.special import fresnel

from judges.basics import positions
from judges.panel import pixel_coverage
from judges.sums import Array, gauss
from optics.camera import Camera
from optics.camera.stop import Circle, Shape, Stop
from optics.plane import Plane

_ROW_BREAKS = 1e-9


def sum_by_hand(
    camera: Camera,
    modulation: NDArray[np.complex128],
    distance: float,
    wavelength: float,
    pixels: Plane,
    field: tuple[float, float],
    finer: float,
    most: float,
) -> Array | None:
    """Light at the pixels' centres, as a share of what a clear panel and stop pass; None where it
    takes more than `most` products. finer: nodes over what is needed."""
    lens, radius = camera.lens, camera.lens.stop_diameter / 2
    z1, z2, near = camera.separation, lens.image_distance, 1 / distance
    wave = np.pi / wavelength
    assert lens.kind == "thin"
    assert not lens.aberrations
    seen = [pixels.coordinates(axis).numpy() for axis in (0, 1)]
    places = [positions(n, camera.panel.pitch) for n in camera.panel.shape]
    tilt = [place / z2 * (1 + z1 * near) for place in field]
    focus = 1 / lens.focus_distance
    slopes = [
        2
        * wave
        * radius
        * max(
            abs((x - s) / z1 - x * focus - u / z2 - f / z2)
            for x in (-radius, radius)
            for s in (places[k][0] - camera.panel.pitch, places[k][-1] + camera.panel.pitch)
            for u in (seen[k].min(), seen[k].max())
            for f in (field[k],)
        )
        for k in (0, 1)
    ]
    # A piece of 48 nodes takes some 60 radians.
    count = finer * (slopes[0] + 40), finer * (slopes[1] / 2 + 20)
    rows, columns = camera.panel.shape
    if count[0] * (2 * count[1] * (columns + pixels.shape[1]) + rows * columns) > most:
        return None

    def sent(axis: int, x: Array) -> NDArray[np.complex128]:
        """Fresnel integrals of thesis Eq. 5.1 and 5.3 over each pixel, at places x at the lens."""
        bend = near + 1 / z1
        centre, half = (x / z1 - tilt[axis]) / bend, camera.panel.active_side / 2
        stretch = math.sqrt(2 * bend / wavelength)
        (s0, c0), (s1, c1) = (
            fresnel(stretch * (places[axis] + side - centre[:, None])) for side in (-half, half)
        )
        own = wave * (x**2 / z1 - bend * centre**2)
        scale = stretch * math.sqrt(wavelength * z1)
        return np.asarray(np.exp(1j * own)[:, None] * (c1 - c0 + 1j * (s1 - s0)) / scale)

    def onward(axis: int, x: Array) -> NDArray[np.complex128]:
        """Lens, and the way to the sensor, without its global phases."""
        lens_phase = -wave * focus * x**2
        kernel = -2 * wave / z2 * np.outer(seen[axis] + field[axis], x)
        return np.exp(1j * (lens_phase + kernel))

    found = np.zeros(pixels.shape, dtype=np.complex128)
    heights, weights, stretches = _rows(lens.stop, count, finer)
    for start in range(0, len(heights), 64):
        some = slice(start, start + 64)
        y = heights[some] * radius
        at_rows = sent(0, y) @ modulation
        line = np.empty((len(y), pixels.shape[1]), dtype=np.complex128)
        for k, parts in enumerate(stretches[some]):
            x, wx = parts
            light = (sent(1, x * radius) @ at_rows[k]) * wx
            line[k] = onward(1, x * radius) @ light
        found += (onward(0, y) * weights[some]) @ line
    found *= radius**2 / (wavelength * z2)
    passed = float(pixel_coverage(camera).sum()) * camera.panel.active_side**2
    return np.asarray(np.abs(found) ** 2 * math.prod(pixels.pitch) / passed)


def _rows(
    stop: Stop, count: tuple[float, float], finer: float
) -> tuple[Array, Array, list[tuple[Array, Array]]]:
    """Heights in stop radii, their weights, and the nodes and weights of each row's open parts."""
    shapes = (stop.opening, *stop.obscurations)
    breaks = sorted({y for shape in shapes for y in _turns(shape)})
    low, high = min(_turns(stop.opening)), max(_turns(stop.opening))
    kept = [y for y in breaks if low <= y <= high]
    heights, weights, stretches = [], [], []
    for a, b in pairwise(kept):
        if b - a < _ROW_BREAKS:
            continue
        t, w = _composite(finer * 40 + count[0] * (b - a) / 1.2)
        angle = t * np.pi / 2
        for y, weight in zip(
            (a + b) / 2 + (b - a) / 2 * np.sin(angle),
            w * np.pi / 2 * (b - a) / 2 * np.cos(angle),
            strict=True,
        ):
            nodes = list(_open(stop, y, count[1]))
            if nodes:
                x, wx = (np.concatenate(part) for part in zip(*nodes, strict=True))
                heights.append(y)
                weights.append(weight)
                stretches.append((x, wx))
    return np.array(heights), np.array(weights), stretches


def _composite(count: float) -> tuple[Array, Array]:
    """Gauss-Legendre nodes in pieces from -1 to 1: long rules are dear, few lengths are shared."""
    pieces = max(1, math.ceil(count / 48))
    nodes, weights = gauss(8 * math.ceil(count / pieces / 8))
    starts = -1 + 2 * np.arange(pieces)[:, None] / pieces
    return (starts + (nodes + 1) / pieces).ravel(), np.tile(weights / pieces, pieces)


def _turns(shape: Shape) -> list[float]:
    if isinstance(shape, Circle):
        return [shape.centre[0] - shape.radius, shape.centre[0] + shape.radius]
    return [y for y, _ in shape.corners]


def _cuts(shape: Shape, y: float) -> list[float]:
    if isinstance(shape, Circle):
        square = shape.radius**2 - (y - shape.centre[0]) ** 2
        half = math.sqrt(square) if square > 0 else 0.0
        return [shape.centre[1] - half, shape.centre[1] + half] if half else []
    return [
        x0 + (y - y0) * (x1 - x0) / (y1 - y0)
        for (y0, x0), (y1, x1) in shape.edges
        if (y0 > y) != (y1 > y)
    ]


def _open(stop: Stop, y: float, count: float) -> Iterator[tuple[Array, Array]]:
    """The nodes and weights of each open part of a row."""
    cuts = sorted(x for shape in (stop.opening, *stop.obscurations) for x in _cuts(shape, y))
    for a, b in pairwise(cuts):
        middle = np.array([y]), np.array([(a + b) / 2])
        closed = any(shape.contains(*middle)[0] for shape in stop.obscurations)
        if stop.opening.contains(*middle)[0] and not closed:
            nodes, weight = _composite(20 + count * (b - a))
            yield (a + b) / 2 + (b - a) / 2 * nodes, weight * (b - a) / 2
