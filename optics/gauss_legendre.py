"""Nodes and weights of Gauss-Legendre quadrature, computed once for each count."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray


@cache
def gauss_legendre(count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Nodes in [-1, 1] and weights that add up to 2, exact for degree 2 count - 1.

    The arrays are shared by all callers and can't be written to. ValueError if count is less
    than 1.
    """
    if count < 1:
        raise ValueError(f"count is {count}; quadrature takes 1 node or more")
    nodes, weights = np.polynomial.legendre.leggauss(count)
    nodes.flags.writeable = weights.flags.writeable = False
    return nodes, weights
