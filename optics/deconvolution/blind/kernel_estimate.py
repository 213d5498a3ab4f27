"""The results of blind deconvolution: the kernel with its score, and the restored picture."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from optics.deconvolution.restored_image import RestoredImage

GOOD, FAIR = 0.9, 0.7
"""Scores from which a kernel may be used without a check, and after a look at the picture."""

MOST_ERROR = math.sqrt(10)
"""Kernel error and noise over the noise, up to which a kernel may be used without a check."""


@dataclass(frozen=True, eq=False)
class KernelEstimate:
    """An estimated blur kernel with its standard deviation and score.

    Parameters
    ----------
    psf : torch.Tensor, (size, size)
        Kernel with its origin at n // 2, nowhere negative, with a sum of 1. Its centroid is as near
        to the origin as `size` allows, since the photograph doesn't show a shift of the scene.
    deviation : torch.Tensor, (size, size)
        Standard deviation of each pixel of the kernel. It comes from the differences between parts
        of the photograph and between searches from two starts, and doesn't include an error that
        all of them share.
    noise : float
        Standard deviation of a pixel of the photograph.
    score : float
        1 less the ratio of the kernel's expected squared error to its energy, 0 to 1.
    error_to_noise : float
        Standard deviation of noise and kernel error together over that of the noise, as the
        photograph's spectrum shows them: see `Observation.disturbance`.
    """

    psf: torch.Tensor
    deviation: torch.Tensor
    noise: float
    score: float
    error_to_noise: float = 1.0

    @property
    def verdict(self) -> str:
        """The score of a blindly estimated blur kernel in words: good, fair or poor.

        The kernel is good from a score of 0.9 if its error isn't much larger than the noise, fair
        from 0.7, and poor below.
        """
        if self.score >= GOOD and self.error_to_noise <= MOST_ERROR:
            return "good: parts of the photograph and searches from two starts agree"
        if self.score >= FAIR:
            return (
                f"fair: its error weighs {self.error_to_noise:.1f} times as much as the noise; "
                "look for ringing in the restored picture"
            )
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
        The estimated kernel.
    restored_image : RestoredImage
        The photograph, restored with that kernel.
    """

    kernel: KernelEstimate
    restored_image: RestoredImage
