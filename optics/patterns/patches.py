"""The neutral pattern, and patches of random phase."""

from __future__ import annotations

import math

import torch

from optics.camera import Panel
from optics.validation import require_positive

__all__ = ["constant_phase", "random_patches"]


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


def random_patches(
    panel: Panel,
    patches: tuple[int, int],
    generator: torch.Generator,
    depth: float = 2 * math.pi,
) -> torch.Tensor:
    """Compute rectangular patches, each of one random phase (thesis section 6.4).

    The phase may jump by any amount at the edges, which don't count as slopes.

    Parameters
    ----------
    panel : Panel
        The panel that shows the pattern.
    patches : tuple of (int, int)
        Rows and columns of patches. Where they don't divide the panel's, some patches are one
        pixel wider.
    generator : torch.Generator
        Source of the random phases.
    depth : float, default 2 pi
        Upper limit of the phases, radians; the lower limit is 0.

    Returns
    -------
    torch.Tensor, (rows, columns), float64
        Phase in radians.

    Raises
    ------
    ValueError
        If there are more patches than pixels, or fewer than one, or the depth isn't positive.
    """
    for name, count, pixels in zip(("rows", "columns"), patches, panel.shape, strict=True):
        if not 1 <= count <= pixels:
            raise ValueError(
                f"patches has {count} {name}; choose 1 to {pixels}, as the panel has pixels"
            )
    require_positive("depth", depth, "rad")
    phase = torch.rand(patches, generator=generator, dtype=torch.float64) * depth
    for axis, (count, pixels) in enumerate(zip(patches, panel.shape, strict=True)):
        place = torch.arange(pixels) * count // pixels
        phase = phase.index_select(axis, place)
    return phase
