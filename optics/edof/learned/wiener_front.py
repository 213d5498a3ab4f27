"""The learned decoder's front: linear filters of captures, for many noise levels at once."""

from __future__ import annotations

import torch

from optics.edof.spectral_criterion import LEAST_NOISE, mean_transfer
from optics.fourier import irfft2, rfft2


class WienerFront:
    """Filters captures by the linear filter of least expected error over depths.

    The filter is that of `optics.edof.spectral_criterion.blind_filter`. What it takes from the
    transfer functions is computed once, for all noise levels.

    Parameters
    ----------
    mean : torch.Tensor, (..., n, n // 2 + 1), complex
        Mean transfer function over the depths.
    power : torch.Tensor, (..., n, n // 2 + 1)
        Mean of its squared modulus.
    spectrum : torch.Tensor, (n, n // 2 + 1)
        Power spectrum of the pictures.
    """

    def __init__(self, mean: torch.Tensor, power: torch.Tensor, spectrum: torch.Tensor) -> None:
        self.mean, self.power, self.spectrum = mean, power, spectrum.to(power)

    @classmethod
    def of_transfers(cls, transfer: torch.Tensor, spectrum: torch.Tensor) -> WienerFront:
        """Return the front that is one filter for all depths of some transfer functions.

        transfer: (depths, n, n // 2 + 1), complex.
        """
        mean, power = mean_transfer(transfer)
        return cls(mean.to(torch.complex64), power.to(torch.float32), spectrum)

    @classmethod
    def of_known_depths(cls, transfer: torch.Tensor, spectrum: torch.Tensor) -> WienerFront:
        """Return the front that has a filter of its own for each capture's known depth.

        transfer: (captures, n, n // 2 + 1), that of each capture.
        """
        return cls(transfer, transfer.real.square() + transfer.imag.square(), spectrum)

    def response(self, noise: torch.Tensor) -> torch.Tensor:
        """Return the filters (captures, n, n // 2 + 1) for captures of some noise levels.

        noise: (captures,), standard deviations, relative to white. The mean of a picture is kept.
        """
        variance = noise.to(self.power).clamp(min=LEAST_NOISE).square()[:, None, None]
        filters = self.spectrum * self.mean.conj() / (self.spectrum * self.power + variance)
        at_zero = torch.zeros_like(self.spectrum, dtype=torch.bool)
        at_zero[0, 0] = True
        inverse = 1 / torch.where(at_zero, self.mean, torch.ones_like(self.mean))
        return torch.where(at_zero, inverse, filters)

    def __call__(self, captures: torch.Tensor, noise: torch.Tensor) -> torch.Tensor:
        """Filter captures (captures, 1, n, n) of some noise levels, (captures,); periodic."""
        shape = (int(captures.shape[-2]), int(captures.shape[-1]))
        return irfft2(rfft2(captures) * self.response(noise)[:, None], shape)
