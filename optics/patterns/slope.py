"""How steep a pattern may be: neighbouring pixels differ by half a wave at most."""

from __future__ import annotations

import math
from collections.abc import Callable

import torch

from optics.camera import Panel
from optics.validation import accepts_numpy, require_finite, rounded_down

_ROUNDING = 1 + 1e-9

__all__ = ["superpose"]


def largest_phase_step(phase: torch.Tensor) -> float:
    """The largest difference of neighbouring pixels, along rows or columns, in radians."""
    steps = [torch.diff(phase, dim=axis) for axis in (0, 1)]
    return max((float(step.abs().max()) for step in steps if step.numel()), default=0.0)


def require_slope(name: str, step: float, remedy: str) -> None:
    """Raise ValueError for a step from pixel to pixel of more than half a wave.

    name: the argument that makes it so steep. remedy: what would be right, with the limit.
    """
    if not step <= math.pi * _ROUNDING:
        raise ValueError(
            f"{name} changes the phase by {step / math.pi:.2f} pi per pixel and the panel can "
            f"show 1 pi at most; {remedy}"
        )


def scale_within_slope(
    name: str, shape: torch.Tensor, strength: float, remedy: Callable[[float], str]
) -> torch.Tensor:
    """A smooth phase of a shape, times a strength; ValueError if that is too steep.

    remedy: says what would be right, given the strength that the pixels just allow.
    """
    steepest = largest_phase_step(shape)
    step = abs(strength) * steepest
    if step > math.pi * _ROUNDING:
        require_slope(name, step, remedy(math.pi / steepest))
    return strength * shape


@accepts_numpy
def superpose(panel: Panel, *phases: torch.Tensor) -> torch.Tensor:
    """The sum of smooth patterns, (rows, columns), radians.

    Patterns that jump (patches, binary gratings, retrieved ones) have no slope that could be
    judged: add those to the sum. Raises ValueError for a sum that is too steep, though none
    of its parts may be, and for parts of another shape than the panel's.
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
