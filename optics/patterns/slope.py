"""Limit the slope of patterns: neighbouring panel pixels may differ by half a wave at most."""

from __future__ import annotations

import math
from collections.abc import Callable

import torch

from optics.camera import Panel
from optics.validation import accepts_numpy, require_finite, rounded_down

__all__ = ["superpose"]

# Factor on the largest allowed phase step, so that rounding errors aren't refused.
_ROUNDING = 1 + 1e-9


def largest_phase_step(phase: torch.Tensor, part: torch.Tensor | None = None) -> float:
    """Compute the largest step between neighbours along rows or columns, in radians.

    part: number of each pixel's part, between which the phase may jump; None for a smooth pattern.
    """
    largest = []
    for axis in (0, 1):
        steps = torch.diff(phase, dim=axis).abs()
        if part is not None:
            steps = steps[torch.diff(part, dim=axis) == 0]
        if steps.numel():
            largest.append(float(steps.max()))
    return max(largest, default=0.0)


def require_slope(name: str, step: float, remedy: str) -> None:
    """Raise ValueError for a step between pixels of more than half a wave.

    name: the argument that makes the phase too steep.
    step: radians.
    remedy: the advice that ends the message, with the limit.
    """
    if not step <= math.pi * _ROUNDING:
        raise ValueError(
            f"{name} changes the phase by {step / math.pi:.2f} pi per pixel and the panel can "
            f"show 1 pi at most; {remedy}"
        )


def scale_within_slope(
    name: str, shape: torch.Tensor, strength: float, remedy: Callable[[float], str]
) -> torch.Tensor:
    """Multiply a smooth phase by a strength; raise ValueError if it gets too steep.

    remedy: returns the advice that ends the message, given the largest strength that the pixels
    allow.
    """
    steepest = largest_phase_step(shape)
    step = abs(strength) * steepest
    if step > math.pi * _ROUNDING:
        require_slope(name, step, remedy(math.pi / steepest))
    return strength * shape


@accepts_numpy
def superpose(panel: Panel, *phases: torch.Tensor) -> torch.Tensor:
    """Sum smooth phases, and check the slope of the sum.

    For patterns with jumps (patches, binary gratings, retrieved ones) this check makes no sense;
    add them to the sum afterwards.

    Parameters
    ----------
    panel : Panel
        The panel that shows the pattern.
    *phases : torch.Tensor or numpy.ndarray
        Smooth patterns in radians, (rows, columns) of the panel.

    Returns
    -------
    torch.Tensor or numpy.ndarray, (rows, columns), float64
        Phase in radians.

    Raises
    ------
    ValueError
        If a pattern isn't finite or its shape isn't the panel's, or if the sum is too steep for the
        pixels, even though none of the patterns may be.
    """
    for phase in phases:
        require_finite("a part", phase)
        if phase.shape != panel.shape:
            raise ValueError(f"a part is {tuple(phase.shape)} pixels; the panel has {panel.shape}")
    total = torch.zeros(panel.shape, dtype=torch.float64)
    for phase in phases:
        total = total + phase
    step = largest_phase_step(total)
    share = rounded_down(math.pi / step) if step else ""
    require_slope("the sum", step, f"make its parts weaker, all by {share} for instance")
    return total
