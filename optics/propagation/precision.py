"""How precisely a way through free space must compute, and can."""

from __future__ import annotations

import math

import torch

from optics.accuracy import FLOAT64_ARITHMETIC, ToleranceError, unreachable_tolerance_error

FIELD32_ARITHMETIC = 1e-6
"""Relative L2 error of a field from two complex64 transforms whose phases were prepared in
float64; measured against complex128, with a margin of two."""

_ROUNDING = 2.3e-16
"""Of a phase in float64, relative: half a unit in the last place, twice."""

_SINGLE_SHARE = 0.5
"""Of the tolerance that single precision may use."""


def phase_rounding(turns: float) -> float:
    """Radians that float64 leaves uncertain of a phase of so many turns."""
    return 2 * math.pi * turns * _ROUNDING


def tolerance_below_error_floor(tol: float, share: float, fixed: float) -> ToleranceError:
    """The refusal of a tolerance, with the least one that can be kept.

    share: of the tolerance, whatever it is, that sampling may use. fixed: the error that
    doesn't become less with it: rounding, and what a model leaves out.
    """
    return unreachable_tolerance_error(tol, fixed / (1 - share))


def working_precision(
    tol: float, turns: float, share: float = 0.0, *, double: bool = False
) -> tuple[torch.dtype, float]:
    """The dtype of the field, and the relative L2 error from rounding.

    turns: the largest phase there is, in turns: made in float64, it is off by 2 pi turns
    times the rounding of a number. share: of the tolerance, that sampling may use. double:
    never complex64. Raises ToleranceError for a tolerance below both.
    """
    phase = phase_rounding(turns)
    if not double and min(_SINGLE_SHARE, 1 - share) * tol > FIELD32_ARITHMETIC:
        dtype, error = torch.complex64, max(FIELD32_ARITHMETIC, phase)
    else:
        dtype, error = torch.complex128, max(FLOAT64_ARITHMETIC, phase)
    if not error < tol * (1 - share):
        raise tolerance_below_error_floor(tol, share, error)
    return dtype, error
