"""What blind deconvolution gives, and how far to trust it."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from optics.deconvolution.restored import Restored

GOOD, FAIR = 0.9, 0.7
"""Scores from which a kernel may be used as it is, and with a look at the picture."""


@dataclass(frozen=True, eq=False)
class Kernel:
    """An estimated blur.

    psf: (size, size), origin n // 2, nowhere negative, with a sum of 1; its centroid is as near to
    the origin as `size` allows, for where the scene lay before the blur nobody can tell. deviation:
    (size, size), standard deviation of each of its pixels, from how parts of the photograph
    agree; an error that all parts share isn't in it. noise: standard deviation of a photograph's
    pixel. score: 0 to 1, the share of the kernel's energy that isn't its expected error.
    """

    psf: torch.Tensor
    deviation: torch.Tensor
    noise: float
    score: float

    @property
    def trust(self) -> str:
        """In words."""
        if self.score >= GOOD:
            return "good: parts of the photograph agree"
        if self.score >= FAIR:
            return "fair: look for ringing in the restored picture"
        return (
            "poor: parts of the photograph tell different kernels. Give a part with many sharp "
            "edges in all directions, or a smaller size"
        )


@dataclass(frozen=True, eq=False)
class Deblurred:
    """kernel: as found. restored: the photograph with it undone."""

    kernel: Kernel
    restored: Restored
