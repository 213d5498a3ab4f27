"""Chebyshev nodes, polynomials through them, and expansions of smooth functions over a plane."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray

from optics.plane import Plane


def chebyshev_nodes(count: int) -> NDArray[np.float64]:
    """Return nodes of interpolation in (-1, 1), the zeros of a Chebyshev polynomial, ascending."""
    return np.asarray(-np.cos(np.pi * (np.arange(count) + 0.5) / count))


def lagrange_basis(nodes: torch.Tensor, places: torch.Tensor) -> torch.Tensor:
    """Return the polynomials that are 1 at one node and 0 at the others, (places, nodes)."""
    flat = places.reshape(-1, 1)
    columns = []
    for number in range(nodes.numel()):
        others = torch.cat([nodes[:number], nodes[number + 1 :]])
        columns.append(((flat - others) / (nodes[number] - others)).prod(1))
    return torch.stack(columns, dim=1)


class ChebyshevExpansion:
    """Expand a function of (y, x) over a plane in products of Chebyshev polynomials.

    The values on d + 1 Chebyshev nodes per axis determine a polynomial of degree d. Costly
    functions are evaluated at these few points only, and two small matrix products give the whole
    picture, accurate to rounding (Trefethen, Approximation Theory and Approximation Practice,
    ch. 3 and 4).

    function: takes y (n, 1) and x (1, n) in metres, float64, and returns values (n, n). nodes:
    the number of nodes per axis.
    """

    def __init__(
        self,
        function: Callable[[torch.Tensor, torch.Tensor], torch.Tensor],
        plane: Plane,
        nodes: int,
    ) -> None:
        angle = math.pi * (torch.arange(nodes, dtype=torch.float64) + 0.5) / nodes
        self._lines = [plane.coordinates(axis) for axis in (0, 1)]
        # Middle and half span of the samples along each axis; a pitch for one sample.
        self._spans = []
        for line, pitch in zip(self._lines, plane.pitch, strict=True):
            low, high = float(line.min()), float(line.max())
            self._spans.append(((low + high) / 2, (high - low) / 2 or pitch))
        y, x = (middle + half * torch.cos(angle) for middle, half in self._spans)
        order = torch.arange(nodes, dtype=torch.float64)
        weight = (2 - (order == 0).to(order)) / nodes
        self._order = order
        there = torch.cos(order[:, None] * angle) * weight[:, None]
        values = function(y[:, None], x[None, :])
        self.coefficients = there @ values.expand(nodes, nodes) @ there.T
        self._column_polynomials = self._polynomials(1, slice(None))

    def _polynomials(self, axis: int, part: slice) -> torch.Tensor:
        """Evaluate the polynomials of all orders at samples of one axis, (samples, orders)."""
        middle, half = self._spans[axis]
        place = ((self._lines[axis][part] - middle) / half).clamp(-1, 1)
        return torch.cos(torch.acos(place)[:, None] * self._order)

    def rows(self, part: slice) -> torch.Tensor:
        """Evaluate the sum on rows of the plane, (rows, columns), float64."""
        return self._polynomials(0, part) @ self.coefficients @ self._column_polynomials.T

    @property
    def tail_share(self) -> float:
        """The share of the highest quarter of orders in the sum of coefficients.

        It estimates the share that orders beyond the expansion would have.
        """
        size, last = self.coefficients.abs(), self._order.numel() * 3 // 4
        inner, whole = float(size[:last, :last].sum()), float(size.sum())
        return (whole - inner) / whole if whole else 0.0


def expand_in_chebyshev(
    function: Callable[[torch.Tensor, torch.Tensor], torch.Tensor], plane: Plane
) -> ChebyshevExpansion | None:
    """Expand a smooth function, such as a lens' phase, over a plane, exact to rounding error.

    Few nodes are taken. Returns None for a function that isn't smooth enough for 64 nodes per axis.
    """
    for nodes in (8, 12, 16, 24, 32, 48, 64):
        found = ChebyshevExpansion(function, plane, nodes)
        # Coefficients this small are rounding errors.
        if found.tail_share <= 1e-14:
            return found
    return None
