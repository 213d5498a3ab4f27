"""What blind deconvolution gives, and how far to trust it."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from optics.deconvolution.restored_image import RestoredImage

GOOD, FAIR = 0.9, 0.7
"""Scores from which a kernel may be used as it is, and with a look at the picture."""


@dataclass(frozen=True, eq=False)
class KernelEstimate:
    """An estimated blur kernel, and how surely it is known.

    Parameters
    ----------
    psf : torch.Tensor, (size, size)
        Kernel with its origin at n // 2, nowhere negative, with a sum of 1. Its centroid is as near
        to the origin as `size` allows, since where the scene lay before the blur can't be known.
    deviation : torch.Tensor, (size, size)
        Standard deviation of each pixel of the kernel, from how well parts of the photograph and
        searches from two starts agree. An error that all of them share isn't in it.
    noise : float
        Standard deviation of a pixel of the photograph.
    score : float
        Share of the kernel's energy that isn't its expected error, 0 to 1.
    """

    psf: torch.Tensor
    deviation: torch.Tensor
    noise: float
    score: float

    @property
    def verdict(self) -> str:
        """Judgement of the score in words: good from 0.9, fair from 0.7, poor below."""
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
    """An estimated blur kernel, and the photograph restored with it.

    Parameters
    ----------
    kernel : KernelEstimate
        The blur as it was found.
    restored_image : RestoredImage
        The photograph with that blur undone.
    """

    kernel: KernelEstimate
    restored_image: RestoredImage
