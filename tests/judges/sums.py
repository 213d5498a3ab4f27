"""What all judges sum with: nodes and weights, plenty of them, and phases in whole turns."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@cache
def gauss(count: int) -> tuple[Array, Array]:
    """At least so many Gauss-Legendre nodes from -1 to 1, in panels, and their weights."""
    panels = math.ceil(count / 96)
    nodes, weights = _legendre(math.ceil(count / panels))
    middles = (2 * np.arange(panels) + 1) / panels - 1
    return (middles[:, None] + nodes / panels).ravel(), np.tile(weights / panels, panels)


@cache
def _legendre(count: int) -> tuple[Array, Array]:
    return np.polynomial.legendre.leggauss(count)


def richardson(function: Callable[[float], Any], at: float, step: float) -> Any:
    """The derivative of a function: central differences, extrapolated to no step at all."""
    steps = [step / 2**k for k in range(4)]
    slopes = [(function(at + h) - function(at - h)) / (2 * h) for h in steps]
    for order in range(1, len(slopes)):
        factor = 4**order
        slopes = [(factor * fine - coarse) / (factor - 1) for coarse, fine in pairwise(slopes)]
    return slopes[0]


def node_count(length: float, slope: float) -> int:
    """Nodes for a phase that turns by so many radians, with plenty to spare."""
    return 48 + math.ceil(0.6 * length * slope)


def phasor(waves: Any) -> NDArray[np.complex128]:
    part = np.asarray(waves - np.rint(waves), dtype=np.float64)
    return np.exp(2j * np.pi * part)


def times(matrix: NDArray[Any], vector: NDArray[Any]) -> NDArray[np.complex128]:
    """A product on one thread: BLAS' threads wait for each other longer than they work."""
    return np.asarray(np.einsum("ij,j->i", matrix, vector))
