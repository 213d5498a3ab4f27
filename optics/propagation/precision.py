"""How precisely a way through free space must compute, and can."""

from __future__ import annotations

import math

import torch

from optics.accuracy import FLOAT64_ARITHMETIC, unkeepable
from optics.propagation.spectral import FIELD32_ARITHMETIC

_ROUNDING = 2.3e-16
"""Of a phase in float64, relative: half a unit in the last place, twice."""

_SINGLE_SHARE = 0.5
"""Of the tolerance that single precision may use."""


def rounding(turns: float) -> float:
    """Radians that float64 leaves uncertain of a phase of so many turns."""
    return 2 * math.pi * turns * _ROUNDING


def working_precision(
    tol: float, turns: float, *, double: bool = False
) -> tuple[torch.dtype, float]:
    """The dtype of the field, and the relative L2 error from rounding.

    turns: the largest phase there is, in turns: made in float64, it is off by 2 pi turns
    times the rounding of a number. double: never complex64. Raises ToleranceError for a
    tolerance below the error.
    """
    phase = rounding(turns)
    if not double and _SINGLE_SHARE * tol >= FIELD32_ARITHMETIC:
        dtype, error = torch.complex64, max(FIELD32_ARITHMETIC, phase)
    else:
        dtype, error = torch.complex128, max(FLOAT64_ARITHMETIC, phase)
    if not error < tol:
        raise unkeepable(tol, error)
    return dtype, error
