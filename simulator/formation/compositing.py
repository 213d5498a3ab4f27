"""Near things before far ones: what is behind shows through where what is in front is blurred."""

from __future__ import annotations

import torch


def over(behind: torch.Tensor, front: torch.Tensor, hidden: torch.Tensor) -> torch.Tensor:
    """Light on samples, of what lies behind with a nearer layer before it.

    behind, front: blurred light of each. hidden: the nearer layer's blurred cover, 0 to 1: of the
    rays to a sample, the share that it stops. That those are as bright as the others of the same
    sample is exact where either layer is in focus, and right to about a percent elsewhere
    (Hasinoff and Kutulakos, A layer-based restoration framework for variable-aperture
    photography, ICCV 2007).
    """
    return behind * (1 - hidden.clamp(0, 1)) + front
