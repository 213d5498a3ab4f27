"""What blind deconvolution gives, and how far to trust it."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from optics.deconvolution.restored_image import RestoredImage

GOOD, FAIR = 0.9, 0.7
"""Scores from which a kernel may be used as it is, and with a look at the picture."""


@dataclass(frozen=True, eq=False)
class KernelEstimate:
    """An estimated blur.

    psf: (size, size), origin n // 2, nowhere negative, with a sum of 1; its centroid is as near to
    the origin as `size` allows, for where the scene lay before the blur nobody can tell. deviation:
    (size, size), standard deviation of each of its pixels, from how parts of the photograph
    agree, and searches from two starts; an error that all share isn't in it. noise: standard
    deviation of a photograph's pixel. score: 0 to 1, the share of the kernel's energy that isn't
    its expected error.
    """

    psf: torch.Tensor
    deviation: torch.Tensor
    noise: float
    score: float

    @property
    def verdict(self) -> str:
        """In words."""
        if self.score >= GOOD:
            return "good: parts of the photograph and searches from two starts agree"
        if self.score >= FAIR:
            return "fair: look for ringing in the restored picture"
        return (
            "poor: parts of the photograph, or two searches, tell different kernels. Give a part "
            "with many sharp edges in all directions, or a smaller size"
        )


@dataclass(frozen=True, eq=False)
class BlindRestoration:
    """kernel: as found. restored_image: the photograph with it undone."""

    kernel: KernelEstimate
    restored_image: RestoredImage
