"""Define the interface of Fourier transforms that hold the wave inside panel pixels."""

from __future__ import annotations

from abc import abstractmethod

import torch

from optics.fourier.transform import PlaneTransform


class PixelIntegralTransform(PlaneTransform):
    """Base class of Fourier integrals over the area of panel pixels, with the lens' wave in them.

    The field that is given is the pattern alone, constant in each pixel.

    Attributes
    ----------
    rounding_growth : float
        Factor by which the transform's rounding errors exceed those of a plain sum.
    """

    rounding_growth: float = 1.0

    @abstractmethod
    def mean_squared_kernel(self, axis: int) -> torch.Tensor:
        """Return how much of a pattern's light a sample of the PSF gets on average, float64.

        It is the mean over the panel's pixels along an axis, (samples,), of the squared modulus of
        a pixel's integral.
        """
