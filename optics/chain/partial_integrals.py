"""Integrate along rows of a stop from the left to any number of ends, piece by piece."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray

from optics.gauss_legendre import gauss_legendre

Array = NDArray[np.float64]


class PartialIntegrals:
    """Divides a chain's rows in the stop into pieces, whose nodes interpolate the integrand.

    In a piece, the values at Gauss-Legendre nodes determine a polynomial in Legendre's basis. Its
    integral up to any end is a sum over the nodes, whose weights depend on the end alone. Whole
    pieces to the left are summed with the usual weights.

    low, high: ends of the rows, in stop radii. slope: steepest phase slope of what is integrated,
    radians per stop radius. turn: half the phase change in a piece, radians.
    """

    def __init__(self, low: float, high: float, slope: float, turn: float) -> None:
        turns = (high - low) * slope / 2
        self.pieces = max(1, math.ceil(turns / turn))
        # exp(i t x) has Chebyshev coefficients J_k(t), which fall below 1e-15 from here on.
        each = turns / self.pieces
        self.nodes = math.ceil(each + 11 * each ** (1 / 3)) + 14
        self._low, self.width = low, (high - low) / self.pieces

    @property
    def node_count(self) -> int:
        return self.pieces * self.nodes

    @cached_property
    def weights(self) -> torch.Tensor:
        """The weights of the nodes of a whole piece of a chain's row, in stop radii."""
        return torch.from_numpy(gauss_legendre(self.nodes)[1] * (self.width / 2))

    def places(self, piece: int) -> torch.Tensor:
        """Return the nodes of a piece of a chain's row, in stop radii."""
        nodes = gauss_legendre(self.nodes)[0]
        return torch.from_numpy(self._low + self.width * (piece + (nodes + 1) / 2))

    def sort_ends(self, end: Array) -> SortedEnds:
        """Sort the ends of a chain's rows, in stop radii, into the pieces."""
        place = (end - self._low) / self.width
        piece = np.clip(place.astype(np.int64), 0, self.pieces - 1)
        inside = np.clip(2 * (place - piece) - 1, -1, 1)
        order = np.argsort(piece, kind="stable")
        starts = np.searchsorted(piece[order], np.arange(self.pieces + 1))
        return SortedEnds(self, inside, order, starts)

    def partial_weights(self, inside: Array) -> torch.Tensor:
        """Return each end's weights in its piece of a chain's row, (ends, nodes).

        inside: the ends, from -1 to 1 over the piece.
        """
        values = np.empty((self.nodes + 1, inside.size))
        values[0], values[1] = 1.0, inside
        for k in range(1, self.nodes):
            # Bonnet's recurrence
            np.multiply(values[k], inside, out=values[k + 1])
            values[k + 1] *= (2 * k + 1) / k
            values[k + 1] -= values[k - 1]
            values[k + 1] *= k / (k + 1)
        degree = np.arange(1, self.nodes)[:, None]
        integrals = np.empty((self.nodes, inside.size))
        integrals[0] = inside + 1
        np.subtract(values[2:], values[:-2], out=integrals[1:])
        integrals[1:] /= 2 * degree + 1
        return torch.from_numpy(integrals.T @ self._coefficients * (self.width / 2))

    @cached_property
    def _coefficients(self) -> Array:
        """Legendre coefficients of a chain's interpolating polynomial, from values at the nodes."""
        nodes, weights = gauss_legendre(self.nodes)
        degree = np.arange(self.nodes)[:, None] + 0.5
        polynomials = np.polynomial.legendre.legvander(nodes, self.nodes - 1).T
        return np.asarray(degree * weights * polynomials)


@dataclass(frozen=True)
class SortedEnds:
    """Holds the ends of a chain's rows, sorted into the pieces of PartialIntegrals.

    inside: each end's place in its piece, -1 to 1. order: numbers of the ends, piece by piece.
    starts: where each piece's ends begin in that order.
    """

    integrals: PartialIntegrals
    inside: Array
    order: NDArray[np.int64]
    starts: NDArray[np.int64]

    def in_piece(self, piece: int, most: int) -> Iterator[tuple[torch.Tensor, torch.Tensor]]:
        """Yield which of a chain's ends lie in a piece, and each one's weights, (ends, nodes).

        At most so many ends at a time.
        """
        for start in range(self.starts[piece], self.starts[piece + 1], most):
            ends = self.order[start : min(start + most, self.starts[piece + 1])]
            yield torch.from_numpy(ends), self.integrals.partial_weights(self.inside[ends])
