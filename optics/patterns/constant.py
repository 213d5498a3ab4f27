"""The neutral pattern."""

from __future__ import annotations

import math

import torch

from optics.camera import Panel

__all__ = ["constant_phase"]


def constant_phase(panel: Panel, phase: float = 0.0) -> torch.Tensor:
    """Compute the neutral phase, which is the same everywhere.

    Parameters
    ----------
    panel : Panel
        The panel that shows the pattern.
    phase : float, default 0.0
        Radians.

    Returns
    -------
    torch.Tensor, (rows, columns), float64
        Phase in radians.

    Raises
    ------
    ValueError
        If the phase isn't finite.
    """
    if not math.isfinite(phase):
        raise ValueError(f"phase is {phase}; it must be finite")
    return torch.full(panel.shape, phase, dtype=torch.float64)
