"""PSFs over the field of view: a few computed, all others interpolated, to a tolerance."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch

from optics.accuracy import ErrorEstimate, ToleranceError
from optics.progress import Progress
from optics.validation import rounded_up

PSFAtPosition = Callable[[tuple[float, float]], torch.Tensor]
"""The PSF, (..., rows, columns), of the point whose image lies at (y, x) metres."""

_MARGIN = 2.0
"""An error is known from few places: it counts twice."""

_MAX_LEVELS = 6
"""Levels of nodes along an axis: 1, 3, 5, 9, 17, 33."""

_CHECK_POSITIONS = ((0.31, -0.73), (-0.57, 0.43), (0.83, 0.61))
"""Places in the field, in half its sides, at which the whole is tried in the end; none is a
node."""


@dataclass(frozen=True)
class SensorRegion:
    """A rectangle of the sensor: from low to high along y and x, metres from the axis."""

    y: tuple[float, float]
    x: tuple[float, float]

    def __post_init__(self) -> None:
        for name, (low, high) in (("y", self.y), ("x", self.x)):
            if not (math.isfinite(low) and math.isfinite(high) and low <= high):
                raise ValueError(f"{name} is {low:g} to {high:g} m; give the lower end first")

    def position_at(self, v: float, u: float) -> tuple[float, float]:
        """Metres (y, x) of a place given in half sides from the middle, -1 to 1."""
        return _position_in_range(self.y, v), _position_in_range(self.x, u)

    def relative_position(self, y: float, x: float) -> tuple[float, float]:
        """A place (y, x) in half sides; ValueError if it lies outside."""
        return _relative_position("y", self.y, y), _relative_position("x", self.x, x)


class PSFOverField:
    """The PSF at any place of a region, from Chebyshev nodes in it.

    The PSF changes smoothly over the field: the light of a panel moves across the stop as the
    point moves. Polynomials through Chebyshev nodes converge as fast as it is smooth
    (Trefethen, Approximation Theory and Approximation Practice, chapter 8), and their nodes
    nest: each axis is refined, as long as the nodes that come in aren't what was interpolated
    there. What was interpolated below zero is set to zero, which is nearer the truth.

    compute_psf: computes a PSF, (..., rows, columns), always on pixels relative to the point's
    image, as PSFOperator with `field` does. region: of the sensor. tol: L2 error of an interpolated
    PSF, relative to the L2 norm of the brightest one: where the lens' stop leaves hardly any light,
    hardly any can be wrong. max_psfs: PSFs that may be computed. Call with (y, x), metres from the
    axis.

    error: measured at three places that are no nodes. node_count: PSFs that were computed.

    Raises ToleranceError if so many nodes don't keep tol, with the error that they leave.
    """

    def __init__(
        self,
        compute_psf: PSFAtPosition,
        region: SensorRegion,
        *,
        tol: float = 1e-2,
        max_psfs: int = 200,
        progress: Progress | None = None,
    ) -> None:
        if not 0 < tol < math.inf:
            raise ValueError(f"tol is {tol:g}; it must be positive")
        if max_psfs < 1:
            raise ValueError(f"max_psfs is {max_psfs}; at least one PSF has to be computed")
        self._compute_psf, self._region, self._tol, self._max_psfs = (
            compute_psf,
            region,
            tol,
            max_psfs,
        )
        self._progress = progress or Progress()
        self._cached_psfs: dict[tuple[float, float], torch.Tensor] = {}
        self._nodes = [_chebyshev_nodes(0), _chebyshev_nodes(0)]
        self._level, self._brightest = [0, 0], 0.0
        self.error = self._refine_to_tolerance()

    @property
    def node_count(self) -> int:
        return len(self._nodes[0]) * len(self._nodes[1])

    def __call__(self, y: float, x: float) -> torch.Tensor:
        return self._interpolate(*self._region.relative_position(y, x))

    def _refine_to_tolerance(self) -> ErrorEstimate:
        """Refine until the tolerance is kept, also where no nodes have come in."""
        sides = (self._region.y, self._region.x)
        wide = [axis for axis, (low, high) in enumerate(sides) if low < high]
        if not wide:
            return ErrorEstimate(0.0, "bound: one place")
        while True:
            wrong = dict.fromkeys(wide, math.inf)
            while max(wrong.values()) > self._tol:
                axis = max(wide, key=lambda one: wrong[one])
                wrong[axis] = self._refine_axis(axis)
            left = self._worst_check_error()
            if left <= self._tol:
                where = f"measured at {len(_CHECK_POSITIONS)} places between the nodes"
                return ErrorEstimate(_MARGIN * left, where)

    def _refine_axis(self, axis: int) -> float:
        """Nodes of the next level along an axis; the largest error at those that came in."""
        self._level[axis] += 1
        before, across = self._nodes[axis], self._nodes[1 - axis]
        if self._level[axis] == _MAX_LEVELS:
            raise self._tolerance_error()
        after = _chebyshev_nodes(self._level[axis])
        if len(after) * len(across) > self._max_psfs:
            raise self._tolerance_error()
        came = [node for node in after if node not in before]
        worst = 0.0
        for node in came:
            self._progress.report(len(self._cached_psfs) / self._max_psfs, "PSFs over the field")
            for other in across:
                place = (node, other) if axis == 0 else (other, node)
                worst = max(worst, self._interpolation_error(*place))
        self._nodes[axis] = after
        return worst

    def _tolerance_error(self) -> ToleranceError:
        return ToleranceError(
            f"tol {self._tol:g} can't be kept by {self._max_psfs} PSFs over this field; "
            f"{self.node_count} leave {rounded_up(max(self._worst_check_error(), self._tol))}"
            ": allow more of them, a smaller region, or a larger tol"
        )

    def _worst_check_error(self) -> float:
        """The worst error at places that are no nodes."""
        return max(self._interpolation_error(v, u) for v, u in _CHECK_POSITIONS)

    def _interpolation_error(self, v: float, u: float) -> float:
        """L2 error of what is interpolated there, over the norm of the brightest PSF."""
        wrong = _l2_norm(self._interpolate(v, u) - self._psf_at_node(v, u))
        return wrong / self._brightest if wrong else 0.0

    def _psf_at_node(self, v: float, u: float) -> torch.Tensor:
        if (v, u) not in self._cached_psfs:
            self._cached_psfs[v, u] = self._compute_psf(self._region.position_at(v, u))
            self._brightest = max(self._brightest, _l2_norm(self._cached_psfs[v, u]))
        return self._cached_psfs[v, u]

    def _interpolate(self, v: float, u: float) -> torch.Tensor:
        down, along = (
            _barycentric_weights(self._nodes[0], v),
            _barycentric_weights(self._nodes[1], u),
        )
        light: torch.Tensor | None = None
        for node_v, weight_v in zip(self._nodes[0], down, strict=True):
            for node_u, weight_u in zip(self._nodes[1], along, strict=True):
                if weight_v * weight_u:
                    part = weight_v * weight_u * self._psf_at_node(node_v, node_u)
                    light = part if light is None else light + part
        assert light is not None
        return light.clamp(min=0)


def _chebyshev_nodes(level: int) -> list[float]:
    """Chebyshev points of the second kind, from -1 to 1; every level holds those before."""
    if level == 0:
        return [0.0]
    steps = 2**level
    # From a table of one level, so that a node is the same number in all of them.
    finest = 2 ** (_MAX_LEVELS - 1)
    return [_chebyshev_point(k * finest // steps, finest) for k in range(steps + 1)]


def _chebyshev_point(k: int, steps: int) -> float:
    return 0.0 if 2 * k == steps else -math.cos(math.pi * k / steps)


def _barycentric_weights(nodes: list[float], place: float) -> list[float]:
    """Of the values at the nodes in the polynomial through them, at a place (barycentric)."""
    if place in nodes or len(nodes) == 1:
        return [1.0 if node == place or len(nodes) == 1 else 0.0 for node in nodes]
    last = len(nodes) - 1
    parts = [
        (-1) ** k * (0.5 if k in (0, last) else 1.0) / (place - node)
        for k, node in enumerate(nodes)
    ]
    return [part / sum(parts) for part in parts]


def _position_in_range(ends: tuple[float, float], share: float) -> float:
    low, high = ends
    return (low + high) / 2 + share * (high - low) / 2


def _relative_position(name: str, ends: tuple[float, float], value: float) -> float:
    low, high = ends
    spare = 1e-9 * max(abs(low), abs(high), high - low)
    if not low - spare <= value <= high + spare:
        raise ValueError(
            f"{name} is {value:g} m; the region of this field goes from {low:g} to {high:g} m"
        )
    return 0.0 if low == high else min(1.0, max(-1.0, (2 * value - low - high) / (high - low)))


def _l2_norm(light: torch.Tensor) -> float:
    return float(light.detach().square().sum().sqrt())
