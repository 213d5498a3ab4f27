"""Interpolate PSFs over the field of view from a few computed ones, to a tolerance."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch

from optics.accuracy import ErrorEstimate, ToleranceError
from optics.progress import Progress
from optics.psf.reference_probe import ERROR_MARGIN
from optics.validation import rounded_up

PSFAtPosition = Callable[[tuple[float, float]], torch.Tensor]
"""Function from the position (y, x) of a point's image, metres, to its PSF (..., rows, columns)."""

_MAX_LEVELS = 6  # number of levels of nodes along an axis; they have 1, 3, 5, 9, 17 and 33 nodes

# Positions in the field, in half sides, at which the final interpolation is checked. None of them
# is a node.
_CHECK_POSITIONS = ((0.31, -0.73), (-0.57, 0.43), (0.83, 0.61))


@dataclass(frozen=True)
class SensorRegion:
    """A rectangle of the sensor: (low, high) along y and x, in metres from the axis."""

    y: tuple[float, float]
    x: tuple[float, float]

    def __post_init__(self) -> None:
        for name, (low, high) in (("y", self.y), ("x", self.x)):
            if not (math.isfinite(low) and math.isfinite(high) and low <= high):
                raise ValueError(f"{name} is {low:g} to {high:g} m; give the lower end first")

    def position_at(self, v: float, u: float) -> tuple[float, float]:
        """Convert a position from half sides of the region to metres (y, x).

        v, u: from the region's middle along y and x, -1 to 1.
        """
        return _position_in_range(self.y, v), _position_in_range(self.x, u)

    def relative_position(self, y: float, x: float) -> tuple[float, float]:
        """Convert a position from metres (y, x) to half sides of the region.

        Raises ValueError if the position lies outside the region.
        """
        return _relative_position("y", self.y, y), _relative_position("x", self.x, x)


class PSFOverField:
    """Interpolates the PSF at any position of a sensor region, from PSFs at Chebyshev nodes.

    The PSF changes smoothly over the field, because the light of a panel moves across the stop as
    the point moves. Polynomials through Chebyshev nodes converge as fast as the smoothness allows
    (Trefethen, Approximation Theory and Approximation Practice, chapter 8). The nodes of each level
    include those of the level before. Each axis is refined until the PSFs at new nodes agree with
    their interpolation. Interpolated values below zero are set to zero, which reduces their error.

    compute_psf: function that computes a PSF, (..., rows, columns), on pixels relative to the
    point's image, as PSFOperator with `field` does. region: of the sensor. tol: L2 error of an
    interpolated PSF, relative to the L2 norm of the brightest PSF, so that PSFs dimmed by the stop
    count less. max_psfs: most PSFs that may be computed. Call the object with (y, x), metres from
    the axis.

    error: measured at three positions between the nodes. node_count: number of nodes.

    Raises ToleranceError, which names the remaining error, if `max_psfs` PSFs don't keep tol.
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
        """Add nodes until interpolation between them keeps the tolerance.

        The error is measured at the new nodes of each level, and last at the check positions.
        Returns the error there.
        """
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
                return ErrorEstimate(ERROR_MARGIN * left, where)

    def _refine_axis(self, axis: int) -> float:
        """Add a level of nodes along an axis; return the largest error at new nodes."""
        self._level[axis] += 1
        before, across = self._nodes[axis], self._nodes[1 - axis]
        if self._level[axis] == _MAX_LEVELS:
            raise self._tolerance_error()
        after = _chebyshev_nodes(self._level[axis])
        if len(after) * len(across) > self._max_psfs:
            raise self._tolerance_error()
        added = [node for node in after if node not in before]
        worst = 0.0
        for node in added:
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
        """Return the largest interpolation error at the check positions."""
        return max(self._interpolation_error(v, u) for v, u in _CHECK_POSITIONS)

    def _interpolation_error(self, v: float, u: float) -> float:
        """Return the L2 error of interpolation at a position, relative to the brightest PSF."""
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
    """Return the Chebyshev points of the second kind of a level, from -1 to 1.

    Each level includes the points of the level before.
    """
    if level == 0:
        return [0.0]
    steps = 2**level
    # All levels take their nodes from the finest one, so that a shared node is the same number.
    finest = 2 ** (_MAX_LEVELS - 1)
    return [_chebyshev_point(k * finest // steps, finest) for k in range(steps + 1)]


def _chebyshev_point(k: int, steps: int) -> float:
    return 0.0 if 2 * k == steps else -math.cos(math.pi * k / steps)


def _barycentric_weights(nodes: list[float], place: float) -> list[float]:
    """Return the nodes' weights for barycentric interpolation."""
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
