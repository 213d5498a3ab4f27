"""Integrate along rows of a stop from the left to any number of ends, piece by piece."""

from __future__ import annotations

import math

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
        self._low, self._width = low, (high - low) / self.pieces

    @property
    def node_count(self) -> int:
        return self.pieces * self.nodes

    @property
    def weights(self) -> torch.Tensor:
        """The weights of the nodes of a whole piece of a chain's row, in stop radii."""
        return torch.from_numpy(gauss_legendre(self.nodes)[1] * (self._width / 2))

    def places(self, piece: int) -> torch.Tensor:
        """Return the nodes of a piece of a chain's row, in stop radii."""
        nodes = gauss_legendre(self.nodes)[0]
        return torch.from_numpy(self._low + self._width * (piece + (nodes + 1) / 2))

    def prepare(self, end: Array) -> None:
        """Sort the ends of a chain's rows, in stop radii, into the pieces."""
        place = (end - self._low) / self._width
        piece = np.clip(place.astype(np.int64), 0, self.pieces - 1)
        self._inside = np.clip(2 * (place - piece) - 1, -1, 1)
        self._order = np.argsort(piece, kind="stable")
        self._starts = np.searchsorted(piece[self._order], np.arange(self.pieces + 1))
        nodes, weights = gauss_legendre(self.nodes)
        degree = np.arange(self.nodes)[:, None] + 0.5
        # Legendre coefficients of the interpolating polynomial, from the values at the nodes.
        self._coefficients = (
            degree * weights * np.polynomial.legendre.legvander(nodes, self.nodes - 1).T
        )

    def ends(self, piece: int) -> tuple[torch.Tensor, torch.Tensor]:
        """Return which of a chain's ends lie in a piece, and each one's weights, (ends, nodes)."""
        ends = self._order[self._starts[piece] : self._starts[piece + 1]]
        t = self._inside[ends]
        values = np.polynomial.legendre.legvander(t, self.nodes)
        integrals = np.empty((t.size, self.nodes))
        integrals[:, 0] = t + 1
        degree = np.arange(1, self.nodes)
        integrals[:, 1:] = (values[:, 2:] - values[:, : self.nodes - 1]) / (2 * degree + 1)
        weights = integrals @ self._coefficients * (self._width / 2)
        return torch.from_numpy(ends), torch.from_numpy(weights)
