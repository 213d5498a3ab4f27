"""Choose the floating-point precision of a free-space propagation."""

from __future__ import annotations

import math

import torch

from optics.accuracy import FLOAT64_ARITHMETIC, ToleranceError, unreachable_tolerance_error
from optics.propagation.tolerance_shares import TOLERANCE_SHARES

FIELD32_ARITHMETIC = 1e-6
"""Relative L2 error of a field after two complex64 transforms, with phases computed in float64.

It was measured against complex128 and multiplied by a margin of two.
"""


def phase_rounding(turns: float) -> float:
    """Return the rounding error in radians of a float64 propagation phase of `turns` turns."""
    # The relative error of such a phase is half a unit in the last place, twice.
    return 2 * math.pi * turns * 2.3e-16


def tolerance_below_error_floor(tol: float, share: float, fixed: float) -> ToleranceError:
    """Return the ToleranceError of a propagation, with the least tolerance that can be kept.

    share: the share of any tolerance that sampling may use. fixed: the error that doesn't decrease
    with the tolerance, which is that of rounding and of the paraxial model.
    """
    return unreachable_tolerance_error(tol, fixed / (1 - share))


def working_precision(
    tol: float, turns: float, share: float = 0.0, *, double: bool = False
) -> tuple[torch.dtype, float]:
    """Return the dtype of a propagated field, and its relative L2 error from rounding.

    turns: the largest phase in turns; computed in float64, its error is `phase_rounding(turns)`.
    share: the share of the tolerance that sampling may use. double: whether complex64 is excluded.
    Raises ToleranceError if neither precision keeps the tolerance.
    """
    phase, most = phase_rounding(turns), min(TOLERANCE_SHARES.single_precision, 1 - share)
    if not double and most * tol > FIELD32_ARITHMETIC:
        dtype, error = torch.complex64, max(FIELD32_ARITHMETIC, phase)
    else:
        dtype, error = torch.complex128, max(FLOAT64_ARITHMETIC, phase)
    if not error < tol * (1 - share):
        raise tolerance_below_error_floor(tol, share, error)
    return dtype, error
