"""Where to take a smooth wave in a stop, and with which weight, so that its integral is exact.

Gauss-Legendre nodes along straight lines converge faster than any power once a wave turns
by less than two radians from one node to the next; so do evenly spaced nodes around a
circle. All rules follow the stop's boundary, so no edge is ever crossed.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import torch

from optics.aperture import Arc, Array, Loop, Piece, Stop

_RADIANS_A_PANEL = 200.0
"""Longer lines are cut into panels: rules of thousands of nodes are slow to find."""


@dataclass(frozen=True)
class Steepness:
    """How fast the phase may turn, in radians per stop radius.

    radial(r): outwards, at radius r and the largest of all below; around(r): along the
    circle, radians per radian of angle. tilt: of the kernel, towards the farthest sample.
    """

    radial: Callable[[float], float]
    around: Callable[[float], float]
    tilt: float

    def along(self, r: float) -> float:
        """In any direction at a radius, kernel included."""
        return math.hypot(self.radial(r), self.around(r) / max(r, 1e-3)) + self.tilt


@dataclass(frozen=True)
class Nodes:
    """Points (y, x) in stop radii and weights whose sum is the open area."""

    y: torch.Tensor
    x: torch.Tensor
    weight: torch.Tensor

    @property
    def count(self) -> int:
        return self.weight.numel()


@functools.cache
def _legendre(count: int) -> tuple[Array, Array]:
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return (nodes + 1) / 2, weights / 2


def nodes_on_line(length: float, slope: float, tol: float) -> int:
    """Gauss-Legendre nodes for a phase that turns by no more than slope x length.

    Half a node a radian of half the turn, some for the transition (Trefethen 2008), and
    some for the tolerance.
    """
    turn = length * slope / 2
    return math.ceil(turn / 2 + 2.5 * turn ** (1 / 3) - 1.5 * math.log10(tol)) + 8


def line_rule(length: float, slope: float, tol: float) -> tuple[Array, Array]:
    """Nodes in 0 to 1 and weights with sum 1, in panels."""
    panels = max(1, math.ceil(length * slope / 2 / _RADIANS_A_PANEL))
    nodes, weights = _legendre(nodes_on_line(length / panels, slope, tol))
    starts = np.arange(panels)[:, None] / panels
    return (starts + nodes / panels).ravel(), np.tile(weights / panels, panels)


def count_nodes(stop: Stop, steepness: Steepness, tol: float) -> int:
    """How many nodes stop_rule() makes, within a few percent, without making them."""
    if stop.rings is not None:
        inner, outer = stop.rings
        along = _radial_count(inner, outer, steepness, tol)
        sides = [_around_count(r, steepness, tol) for r in np.linspace(inner, outer, 9)]
        return int(along * np.trapezoid(sides) / 8)
    if stop.sides is not None:
        y0, y1, x0, x1 = stop.sides
        slope = steepness.along(1.0)
        return nodes_in(y1 - y0, slope, tol) * nodes_in(x1 - x0, slope, tol)
    fans = (_fan_counts(loop, piece, steepness, tol) for loop, piece in _pieces(stop))
    return sum(rays * nodes_in(reach, slope, tol) for reach, slope, rays in fans)


def stop_rule(stop: Stop, steepness: Steepness, tol: float) -> Nodes:
    """Nodes and weights of an integral over a stop."""
    if stop.rings is not None:
        return _rings(*stop.rings, steepness, tol)
    if stop.sides is not None:
        (y, wy), (x, wx) = product_rule(stop, steepness, tol)
        return _joined([(np.repeat(y, x.size), np.tile(x, y.size), (wy[:, None] * wx).ravel())])
    return _joined([_fan(loop, piece, steepness, tol) for loop, piece in _pieces(stop)])


def product_rule(
    stop: Stop, steepness: Steepness, tol: float
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Rows and columns of nodes, with their weights, over an upright rectangle."""
    assert stop.sides is not None
    y0, y1, x0, x1 = stop.sides
    slope = steepness.along(1.0)
    (ty, wy), (tx, wx) = (line_rule(side, slope, tol) for side in (y1 - y0, x1 - x0))
    return (y0 + (y1 - y0) * ty, (y1 - y0) * wy), (x0 + (x1 - x0) * tx, (x1 - x0) * wx)


def _joined(parts: list[tuple[Array, Array, Array]]) -> Nodes:
    y, x, weight = (torch.from_numpy(np.concatenate(c)) for c in zip(*parts, strict=True))
    return Nodes(y, x, weight)


def _pieces(stop: Stop) -> Iterator[tuple[Loop, Piece]]:
    return ((loop, piece) for loop in stop.loops for piece in loop.pieces)


def nodes_in(length: float, slope: float, tol: float) -> int:
    """How many nodes line_rule() makes."""
    panels = max(1, math.ceil(length * slope / 2 / _RADIANS_A_PANEL))
    return panels * nodes_on_line(length / panels, slope, tol)


def _radial_count(inner: float, outer: float, steepness: Steepness, tol: float) -> int:
    return nodes_in(outer - inner, steepness.radial(outer) + steepness.tilt, tol)


def _around_count(r: float, steepness: Steepness, tol: float) -> int:
    """Evenly spaced nodes around a circle: more than the cycles of the fastest harmonic."""
    turn = steepness.tilt * r + steepness.around(r)
    return math.ceil(turn + 4.0 * turn ** (1 / 3) - 2.0 * math.log10(tol)) + 6


def _rings(inner: float, outer: float, steepness: Steepness, tol: float) -> Nodes:
    slope = steepness.radial(outer) + steepness.tilt
    t, along = line_rule(outer - inner, slope, tol)
    radii, along = inner + (outer - inner) * t, (outer - inner) * along
    counts = np.array([_around_count(r, steepness, tol) for r in radii])
    starts = np.cumsum(counts) - counts
    number = np.arange(counts.sum()) - np.repeat(starts, counts)
    angle = 2 * math.pi * number / np.repeat(counts, counts)
    r = np.repeat(radii, counts)
    weight = np.repeat(2 * math.pi * radii * along / counts, counts)
    return _joined([(r * np.sin(angle), r * np.cos(angle), weight)])


def _fan_counts(
    loop: Loop, piece: Piece, steepness: Steepness, tol: float
) -> tuple[float, float, int]:
    """The longest ray of a fan, the slope along it, and the number of rays."""
    y, x = piece.points(np.linspace(0, 1, 33))
    reach = float(np.hypot(y - loop.centre[0], x - loop.centre[1]).max())
    slope = steepness.along(1.0)
    if isinstance(piece, Arc) and piece.whole:
        rays = _around_count(piece.radius, steepness, tol)
        rays += math.ceil(math.hypot(*loop.centre) * slope)
    else:
        rays = nodes_in(piece.length, slope, tol)
    return reach, slope, rays


def _fan(loop: Loop, piece: Piece, steepness: Steepness, tol: float) -> tuple[Array, Array, Array]:
    """The area that rays from the loop's centre to a piece of its boundary sweep."""
    reach, slope, count = _fan_counts(loop, piece, steepness, tol)
    s, along = line_rule(reach, slope, tol)
    if isinstance(piece, Arc) and piece.whole:
        t, across = np.arange(count) / count, np.full(count, 1 / count)
    else:
        t, across = line_rule(piece.length, slope, tol)
    (y, x), (dy, dx) = piece.points(t), piece.velocity(t)
    y, x = y - loop.centre[0], x - loop.centre[1]
    weight = loop.sign * np.outer(s * along, across * (x * dy - y * dx))
    return (
        (loop.centre[0] + np.outer(s, y)).ravel(),
        (loop.centre[1] + np.outer(s, x)).ravel(),
        weight.ravel(),
    )
