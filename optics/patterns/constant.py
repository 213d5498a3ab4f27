"""The neutral pattern."""

from __future__ import annotations

import math

import torch

from optics.camera import Panel

__all__ = ["constant_phase"]


def constant_phase(panel: Panel, phase: float = 0.0) -> torch.Tensor:
    """The same phase everywhere: a neutral pattern."""
    if not math.isfinite(phase):
        raise ValueError(f"phase is {phase}; it must be finite")
    return torch.full(panel.shape, phase, dtype=torch.float64)
