"""A smooth function over a plane of samples, from its values at few points."""

from __future__ import annotations

import math
from collections.abc import Callable

import torch

from optics.plane import Plane

_NODE_COUNTS = (8, 12, 16, 24, 32, 48, 64)
_MAX_TAIL_SHARE = 1e-14
"""Of the sum of all coefficients, what the last of them may hold together: rounding."""


class ChebyshevExpansion:
    """A function of (y, x) over a plane, as a sum of products of Chebyshev polynomials.

    A polynomial of degree d is known by its values on d + 1 Chebyshev nodes an axis: recurrences
    and roots run on few points, and two small products of matrices fill a picture, to rounding
    (Trefethen, Approximation Theory and Approximation Practice, ch. 3 and 4).

    function: of y (n, 1) and x (1, n) in metres, float64; its values (n, n). nodes: an axis.
    """

    def __init__(
        self,
        function: Callable[[torch.Tensor, torch.Tensor], torch.Tensor],
        plane: Plane,
        nodes: int,
    ) -> None:
        angle = math.pi * (torch.arange(nodes, dtype=torch.float64) + 0.5) / nodes
        self._lines = [plane.coordinates(axis) for axis in (0, 1)]
        self._spans = [
            _centre_and_half_span(line, plane.pitch[axis]) for axis, line in enumerate(self._lines)
        ]
        y, x = (middle + half * torch.cos(angle) for middle, half in self._spans)
        order = torch.arange(nodes, dtype=torch.float64)
        weight = (2 - (order == 0).to(order)) / nodes
        self._order = order
        there = torch.cos(order[:, None] * angle) * weight[:, None]
        values = function(y[:, None], x[None, :])
        self.coefficients = there @ values.expand(nodes, nodes) @ there.T
        self._column_polynomials = self._polynomials(1, slice(None))

    def _polynomials(self, axis: int, part: slice) -> torch.Tensor:
        """Of all orders at some of the samples, (samples, orders)."""
        middle, half = self._spans[axis]
        place = ((self._lines[axis][part] - middle) / half).clamp(-1, 1)
        return torch.cos(torch.acos(place)[:, None] * self._order)

    def rows(self, part: slice) -> torch.Tensor:
        """The function on some rows of the plane, (rows, columns), float64."""
        return self._polynomials(0, part) @ self.coefficients @ self._column_polynomials.T

    @property
    def tail_share(self) -> float:
        """The last orders' share of all coefficients: what orders beyond them may hold."""
        size, last = self.coefficients.abs(), self._order.numel() * 3 // 4
        inner = float(size[:last, :last].sum())
        whole = float(size.sum())
        return (whole - inner) / whole if whole else 0.0


def expand_in_chebyshev(
    function: Callable[[torch.Tensor, torch.Tensor], torch.Tensor], plane: Plane
) -> ChebyshevExpansion | None:
    """By as many nodes as it takes to rounding; None for a function that isn't so smooth."""
    for nodes in _NODE_COUNTS:
        found = ChebyshevExpansion(function, plane, nodes)
        if found.tail_share <= _MAX_TAIL_SHARE:
            return found
    return None


def _centre_and_half_span(line: torch.Tensor, pitch: float) -> tuple[float, float]:
    """The middle of the samples, and half of what they span."""
    low, high = float(line.min()), float(line.max())
    return (low + high) / 2, (high - low) / 2 or pitch
