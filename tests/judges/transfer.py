"""Transfer functions of a round stop in closed form, in focus and out of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import jv

Array = NDArray[np.float64]


def clear_stop(v: Array) -> Array:
    """Transfer of a round stop in focus, at shares v of the cut-off frequency (Goodman 6.3)."""
    v = np.clip(np.abs(v), 0, 1)
    return np.asarray(2 / np.pi * (np.arccos(v) - v * np.sqrt(1 - v**2)))


def hopkins_series(v: float, waves: float) -> float:
    """A round stop out of focus, as Bessel functions (Hopkins, Proc. R. Soc. A 231, 91, 1955).

    v: share of the cut-off frequency. waves: of defocus at the stop's edge.
    """
    a, beta = 8 * np.pi * waves * v, np.arccos(v)
    m = np.arange(int(a) + 60)
    n = m[1:]
    even = beta * jv(1, a) - np.sum(
        (-1.0) ** n * np.sin(2 * n * beta) / (2 * n) * (jv(2 * n - 1, a) - jv(2 * n + 1, a))
    )
    odd = np.sum(
        (-1.0) ** m * np.sin((2 * m + 1) * beta) / (2 * m + 1) * (jv(2 * m, a) - jv(2 * m + 2, a))
    )
    return float(4 / (np.pi * a) * (np.cos(a * v) * even - np.sin(a * v) * odd))
