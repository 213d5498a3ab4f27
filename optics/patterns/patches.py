"""Patches of random phase."""

from __future__ import annotations

import math

import torch

from optics.camera import Panel
from optics.validation import require_positive

__all__ = ["random_patches"]


def random_patches(
    panel: Panel,
    patches: tuple[int, int],
    generator: torch.Generator,
    depth: float = 2 * math.pi,
) -> torch.Tensor:
    """Rectangles, each of one phase between 0 and `depth` radians (thesis section 6.4).

    patches: (rows, columns) of them; where they don't divide the panel's, some are a pixel
    wider. Edges may be of any height: they are no slope.
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
