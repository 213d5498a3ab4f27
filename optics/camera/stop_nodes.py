"""Nodes and weights that integrate a smooth wave over a stop to a tolerance.

Gauss-Legendre nodes along straight lines converge faster than any power once the phase changes by
less than two radians from node to node. Evenly spaced nodes around a circle do so, too. All rules
follow the stop's boundary, so that no rule integrates across an edge.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy.spatial
import torch
from numpy.typing import NDArray

from optics.accuracy import MachineSpeed, require_planning_time
from optics.camera.stop import Array, Polygon, Stop
from optics.camera.stop_areas import Interval, break_radii, open_arcs
from optics.gauss_legendre import gauss_legendre

_CHUNK_NODES = 1 << 20  # nodes that are computed at a time

_WHAT = "the integral over the stop"

_NodeChunk = tuple[Array, Array, Array]  # positions (y, x) in stop radii, and weights

# Radii at which open arcs are evaluated to estimate the number of nodes and the arcs' ends.
_SPARSE_NODES = 16

_MANY_ARCS = 32  # open arcs on a circle from which on they are taken together; chosen

_RULE_PASSES = 60.0  # passes over a node while a rule is computed; measured

_STEPS_PER_ARC = 6.0  # steps of Python for each arc of a rule; measured

# Steps of Python for each edge of a stop's shapes and each radius of its rule; measured.
_STEPS_PER_EDGE = 2.0


@dataclass(frozen=True)
class PhaseSlopeBound:
    """Bounds how fast the phase of a wave changes, in radians per stop radius.

    radial: radial(r) bounds the radial slope at all radii up to r.
    azimuthal: azimuthal(r) bounds the slope along the circle of radius r, in radians per radian of
        angle.
    tilt: slope of the Fourier kernel of the farthest sample.
    azimuthal_cycles: most cycles that the wave makes around the axis.
    """

    radial: Callable[[float], float]
    azimuthal: Callable[[float], float]
    tilt: float
    azimuthal_cycles: int = 1

    def largest_slope(self, r: float) -> float:
        """Bound the slope at radius r in any direction, with the Fourier kernel's."""
        return math.hypot(self.radial(r), self.azimuthal(r) / max(r, 1e-3)) + self.tilt


@dataclass(frozen=True)
class QuadratureNodes:
    """Nodes (y, x) in stop radii, and weights whose sum is the open area."""

    y: torch.Tensor
    x: torch.Tensor
    weight: torch.Tensor

    @property
    def count(self) -> int:
        return self.weight.numel()


@functools.cache
def _unit_interval_rule(count: int) -> tuple[Array, Array]:
    nodes, weights = gauss_legendre(count)
    return (nodes + 1) / 2, weights / 2


def gauss_node_count(length: float, slope: float, tol: float) -> int:
    """Return the number of Gauss-Legendre nodes that a line needs for a tolerance.

    The phase along the line changes by slope x length at most. The rule takes half a node per
    radian of half that change, and more for the transition to convergence (Trefethen 2008) and for
    the tolerance.
    """
    turn = length * slope / 2
    return math.ceil(turn / 2 + 2.5 * turn ** (1 / 3) - 1.5 * math.log10(tol)) + 8


def _subinterval_count(length: float, slope: float) -> int:
    # Gauss-Legendre rules of thousands of nodes are slow to compute, so a line is divided where
    # half of its phase change exceeds 200 rad.
    return max(1, math.ceil(length * slope / 2 / 200.0))


def line_rule(length: float, slope: float, tol: float) -> tuple[Array, Array]:
    """Return composite Gauss-Legendre nodes along a line, and their weights.

    The nodes lie between 0 and 1, and the weights add up to 1.
    length: of the line, in stop radii.
    slope: the steepest slope of the phase along it, in radians per stop radius.
    """
    panels = _subinterval_count(length, slope)
    nodes, weights = _unit_interval_rule(gauss_node_count(length / panels, slope, tol))
    starts = np.arange(panels)[:, None] / panels
    return (starts + nodes / panels).ravel(), np.tile(weights / panels, panels)


def line_rule_node_count(length: float, slope: float, tol: float) -> int:
    """Return the number of nodes of line_rule()."""
    panels = _subinterval_count(length, slope)
    return panels * gauss_node_count(length / panels, slope, tol)


def count_nodes(stop: Stop, slope_bound: PhaseSlopeBound, tol: float) -> int:
    """Estimate how many nodes stop_rule() needs, within some percent, without computing them."""
    rule = _StopRule(stop, slope_bound, tol)
    if stop.annulus_radii is not None:
        inner, outer = stop.annulus_radii
        count, some = _sparse_line_nodes(outer - inner, rule.radial_slope(outer), tol)
        radii = inner + (outer - inner) * some
        return int(count * np.mean([rule.circle_node_count(r) for r in radii.tolist()]))
    return int(min(rule.row_node_count(), _arc_rule_node_count(rule)))


def rule_seconds(
    stop: Stop, slope_bound: PhaseSlopeBound, tol: float, speed: MachineSpeed
) -> float:
    """Predict the processor time in which stop_rule() finds its nodes, in seconds."""
    rule = _StopRule(stop, slope_bound, tol)
    seconds = _RULE_PASSES * count_nodes(stop, slope_bound, tol) * speed.touch
    if stop.annulus_radii is not None:
        return seconds + line_rule_node_count(1.0, rule.radial_slope(1.0), tol) * speed.step
    if rule.prefers_rows():
        return seconds
    shapes = (stop.opening, *stop.obscurations)
    edges = sum(len(shape.edges) if isinstance(shape, Polygon) else 1 for shape in shapes)
    for low, high in pairwise(break_radii(stop)):
        arcs = len(open_arcs(stop, (low + high) / 2))
        steps = _STEPS_PER_ARC * arcs + _STEPS_PER_EDGE * edges
        count = line_rule_node_count(math.pi, rule.arc_integral_slope(low, high), tol)
        seconds += count * steps * speed.step
    return seconds


def stop_rule(stop: Stop, slope_bound: PhaseSlopeBound, tol: float) -> QuadratureNodes:
    """Return the nodes and weights of an integral over the open area."""
    return _join_chunks(list(_StopRule(stop, slope_bound, tol).chunks()))


def stop_rule_blocks(
    stop: Stop, slope_bound: PhaseSlopeBound, tol: float, max_nodes: int
) -> Iterator[QuadratureNodes]:
    """Yield the nodes of stop_rule() in blocks of about `max_nodes`."""
    gathered: list[_NodeChunk] = []
    count = 0
    for part in _StopRule(stop, slope_bound, tol).chunks():
        if gathered and count + part[2].size > max_nodes:
            yield _join_chunks(gathered)
            gathered, count = [], 0
        gathered.append(part)
        count += part[2].size
    yield _join_chunks(gathered)


def _join_chunks(parts: list[_NodeChunk]) -> QuadratureNodes:
    y, x, weight = (torch.from_numpy(np.concatenate(c)) for c in zip(*parts, strict=True))
    return QuadratureNodes(y, x, weight)


def product_rule(
    stop: Stop, slope_bound: PhaseSlopeBound, tol: float
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Return the nodes and weights along y and x over an upright rectangle."""
    assert stop.rectangle_bounds is not None
    y0, y1, x0, x1 = stop.rectangle_bounds
    slope = slope_bound.largest_slope(1.0)
    (ty, wy), (tx, wx) = (line_rule(side, slope, tol) for side in (y1 - y0, x1 - x0))
    return (y0 + (y1 - y0) * ty, (y1 - y0) * wy), (x0 + (x1 - x0) * tx, (x1 - x0) * wx)


@functools.lru_cache(maxsize=32)
def _arc_rule_node_count(rule: _StopRule) -> int:
    """Return the number of nodes on open arcs; kept, as all methods of a PSF ask for it."""
    total = 0.0
    for low, high in pairwise(break_radii(rule.stop)):
        require_planning_time(_WHAT)
        slope = rule.arc_integral_slope(low, high)
        count, some = _sparse_line_nodes(math.pi, slope, rule.tol)
        radii, _ = _end_clustered_radii(low, high, math.pi * (some - 0.5))
        found = sum(rule.arcs_node_count(r, open_arcs(rule.stop, r)) for r in radii.tolist())
        total += count * found / _SPARSE_NODES
    return int(total)


def _sparse_line_nodes(length: float, slope: float, tol: float) -> tuple[int, Array]:
    """Return the number of nodes of line_rule(), and an even sample of the nodes."""
    count = line_rule_node_count(length, slope, tol)
    panels = _subinterval_count(length, slope)
    number = ((np.arange(_SPARSE_NODES) + 0.5) / _SPARSE_NODES * count).astype(np.int64)
    panel, place = np.divmod(number, count // panels)
    return count, (panel + _unit_interval_rule(count // panels)[0][place]) / panels


@dataclass(frozen=True)
class _StopRule:
    """The nodes of an integral over a stop, of a wave with bounded slopes, to a tolerance."""

    stop: Stop
    bound: PhaseSlopeBound
    tol: float

    def chunks(self) -> Iterator[_NodeChunk]:
        """Yield the nodes: rings of a disc, rows of a rectangle, or arcs between the edges."""
        if self.stop.annulus_radii is not None:
            return self._ring_nodes(*self.stop.annulus_radii)
        return self._row_nodes() if self.prefers_rows() else self._arc_nodes()

    def prefers_rows(self) -> bool:
        """Tell whether rows and columns are taken, which follow a rectangle's edges.

        Far out of focus, arcs need fewer nodes, because they follow the wave.
        """
        rows = self.row_node_count()
        return rows < math.inf and rows <= _arc_rule_node_count(self)

    def row_node_count(self) -> float:
        """Return the number of nodes in rows and columns of a rectangle, infinity for others."""
        if self.stop.rectangle_bounds is None:
            return math.inf
        y0, y1, x0, x1 = self.stop.rectangle_bounds
        slope = self.bound.largest_slope(1.0)
        rows, columns = (line_rule_node_count(d, slope, self.tol) for d in (y1 - y0, x1 - x0))
        return rows * columns

    def _row_nodes(self) -> Iterator[_NodeChunk]:
        (y, wy), (x, wx) = product_rule(self.stop, self.bound, self.tol)
        rows = max(1, _CHUNK_NODES // x.size)
        for start in range(0, y.size, rows):
            require_planning_time(_WHAT)
            part, weight = y[start : start + rows], wy[start : start + rows]
            yield np.repeat(part, x.size), np.tile(x, part.size), (weight[:, None] * wx).ravel()

    def radial_slope(self, r: float) -> float:
        return self.bound.radial(r) + self.bound.tilt

    def circle_node_count(self, r: float) -> int:
        """Return how many evenly spaced nodes resolve all harmonics on a circle."""
        kernel = _harmonic_count(self.bound.tilt * r, self.tol)
        slope, cycles = self.bound.azimuthal(r), self.bound.azimuthal_cycles
        # A wave of n cycles around the axis has only harmonics that are multiples of n.
        return kernel + (cycles * _harmonic_count(slope / cycles, self.tol) if slope else 0)

    def _ring_nodes(self, inner: float, outer: float) -> Iterator[_NodeChunk]:
        """Yield evenly spaced nodes on whole circles around the axis."""
        t, along = line_rule(outer - inner, self.radial_slope(outer), self.tol)
        radii, along = inner + (outer - inner) * t, (outer - inner) * along
        counts = np.array([self.circle_node_count(r) for r in radii])
        most = max(1, _CHUNK_NODES // int(counts.max()))
        for start in range(0, radii.size, most):
            require_planning_time(_WHAT)
            part = slice(start, start + most)
            some = counts[part]
            number = np.arange(some.sum()) - np.repeat(np.cumsum(some) - some, some)
            angle = 2 * math.pi * number / np.repeat(some, some)
            r = np.repeat(radii[part], some)
            weight = np.repeat(2 * math.pi * radii[part] * along[part] / some, some)
            yield r * np.sin(angle), r * np.cos(angle), weight

    def _arc_nodes(self) -> Iterator[_NodeChunk]:
        """Yield nodes on the arcs of circles around the axis that the stop leaves open.

        Defocus is constant along an arc, so that only the Fourier kernel needs nodes there.
        """
        for low, high in pairwise(break_radii(self.stop)):
            t, along = line_rule(math.pi, self.arc_integral_slope(low, high), self.tol)
            radii, steps = _end_clustered_radii(low, high, math.pi * (t - 0.5))
            for r, step in zip(radii.tolist(), (math.pi * along * steps).tolist(), strict=True):
                require_planning_time(_WHAT)
                for around, weight in self._arcs_rules(r, open_arcs(self.stop, r)):
                    yield r * np.sin(around), r * np.cos(around), step * r * weight

    def arc_integral_slope(self, low: float, high: float) -> float:
        """Bound how fast the phase changes in the integral over arcs, rad per radian.

        The angle is that of _end_clustered_radii().
        """
        speed = _largest_end_speed(self.stop, low, high)
        turned = self.bound.azimuthal(high) / max(high, 1e-3)
        return self.bound.radial(high) * (high - low) / 2 + (self.bound.tilt + turned) * speed

    def arcs_node_count(self, r: float, arcs: list[Interval]) -> int:
        """Return the number of nodes on the open arcs of a circle."""
        if self._are_many_short(r, arcs):
            return int(self._short_arcs_node_counts(r, arcs).sum())
        total = 0
        for arc in arcs:
            pieces, angle, slope = self._pieces(r, arc)
            total += (
                pieces * line_rule_node_count(angle, slope, self.tol)
                if pieces
                else self.circle_node_count(r)
            )
        return total

    def _arcs_rules(self, r: float, arcs: list[Interval]) -> Iterator[tuple[Array, Array]]:
        """Yield angles along the open arcs of a circle, and weights whose sums are their angles."""
        if self._are_many_short(r, arcs):
            counts = self._short_arcs_node_counts(r, arcs)
            first, last = np.transpose(arcs)
            for count in np.unique(counts):
                alike = counts == count
                t, weight = _unit_interval_rule(int(count))
                turn = (last - first)[alike, None]
                yield (first[alike, None] + turn * t).ravel(), (turn * weight).ravel()
            return
        for arc in arcs:
            pieces, angle, slope = self._pieces(r, arc)
            if not pieces:
                count = self.circle_node_count(r)
                step = 2 * math.pi / count
                yield step * np.arange(count, dtype=np.float64), np.full(count, step)
                continue
            t, weight = line_rule(angle, slope, self.tol)
            starts = arc[0] + angle * np.arange(pieces, dtype=np.float64)[:, None]
            yield (starts + angle * t).ravel(), np.tile(np.multiply(angle, weight), pieces)

    def _pieces(self, r: float, arc: Interval) -> tuple[int, float, float]:
        """Return how many pieces make up an open arc, and the angle and phase slope of each.

        Each is half a circle at most; along a longer one, the slope of a tilt varies too much for
        the spare nodes of gauss_node_count(). A whole circle has no pieces.
        """
        turn = arc[1] - arc[0]
        if turn >= 2 * math.pi:
            return 0, turn, 0.0
        pieces = math.ceil(turn / math.pi)
        angle = turn / pieces
        if angle * self.bound.azimuthal_cycles > math.pi * (1 + 1e-9):
            # Over more than half a cycle, the phase's slope varies too much, too. The frequency of
            # the fastest harmonic is the same everywhere.
            return pieces, angle, self.circle_node_count(r)
        return pieces, angle, self._arc_slope(r)

    def _arc_slope(self, r: float) -> float:
        """Return the steepest phase slope along a circle, in rad per radian."""
        return self.bound.tilt * r + self.bound.azimuthal(r)

    def _are_many_short(self, r: float, arcs: list[Interval]) -> bool:
        """Tell whether open arcs are so many, and each so short, to be taken together."""
        if len(arcs) < _MANY_ARCS:
            return False
        longest = float(np.diff(arcs).max())
        short = longest * self.bound.azimuthal_cycles < math.pi
        return short and _subinterval_count(longest, self._arc_slope(r)) == 1

    def _short_arcs_node_counts(self, r: float, arcs: list[Interval]) -> NDArray[np.int64]:
        """Return gauss_node_count() of each of many short arcs."""
        first, last = np.transpose(arcs)
        turn = (last - first) * self._arc_slope(r) / 2
        spare = 2.5 * turn ** (1 / 3) - 1.5 * math.log10(self.tol)
        return np.asarray(np.ceil(turn / 2 + spare), dtype=np.int64) + 8


def _harmonic_count(turn: float, tol: float) -> int:
    """Return how many harmonics on a circle have amplitudes above a tolerance.

    The wave is exp(i turn sin(angle)). The amplitudes of its harmonics are Bessel functions.
    """
    return math.ceil(turn + 4.0 * turn ** (1 / 3) - 2.0 * math.log10(tol)) + 6


def _end_clustered_radii(low: float, high: float, angle: Array) -> tuple[Array, Array]:
    """Return radii that cluster at `low` and `high`, and their derivatives by the angle.

    The angle runs from -pi/2 to pi/2. The integrand stays smooth in the angle where an edge of the
    stop is tangent to a circle.
    """
    middle, half = (low + high) / 2, (high - low) / 2
    return middle + half * np.sin(angle), half * np.cos(angle)


@functools.lru_cache(maxsize=256)
def _largest_end_speed(stop: Stop, low: float, high: float) -> float:
    """Bound how fast the radius grows, or the ends of the open arcs move, per radian.

    The ends may move along the stop's edge much faster than the radius grows.
    """
    angle = np.linspace(-math.pi / 2, math.pi / 2, _SPARSE_NODES + 1)[1:-1]
    radii, _ = _end_clustered_radii(low, high, angle)
    ends = [
        np.array([r * np.exp(1j * end) for arc in open_arcs(stop, r) for end in arc])
        for r in radii.tolist()
    ]
    moved = [float(_nearest_distances(b, a).max()) for a, b in pairwise(ends) if a.size and b.size]
    # The factor 1.2 is a margin, because the ends are followed at few radii only.
    return max([(high - low) / 2, *(1.2 * m / float(angle[1] - angle[0]) for m in moved)])


def _nearest_distances(
    points: NDArray[np.complex128], others: NDArray[np.complex128]
) -> NDArray[np.float64]:
    """Return the distance of each point to the nearest of some others."""
    if points.size * others.size < 1 << 16:
        return np.asarray(np.abs(points[:, None] - others).min(axis=1))
    tree = scipy.spatial.cKDTree(others.view(np.float64).reshape(-1, 2))
    return np.asarray(tree.query(points.view(np.float64).reshape(-1, 2))[0])
