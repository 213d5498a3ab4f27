"""Surfaces at several depths, of which each hides what lies behind it."""

from __future__ import annotations

import torch

from optics.fourier import irfft2, rfft2
from optics.operators.base import Operator
from optics.operators.blur import transfer_function
from optics.operators.varying import require_matching_psfs
from optics.validation import accepts_numpy, as_floating_point


class OccludingBlur(Operator):
    """The blurred light of surfaces at several depths, each of which hides what lies behind it.

    y = sum_k t_k (h_k * (a_k x_k)), where x is (surfaces, rows, columns) and h_k the PSF of surface
    k. Each surface continues behind those that hide it, with the coverage a_k = sum of visibility_j
    up to k. Each transmits 1 - h * a, so that t_k is the product of those in front.

    What is hidden is hidden from all rays of a pixel alike. That is exact where what lies behind is
    in focus (Hasinoff and Kutulakos 2007). Too much light gets past an edge where both surfaces are
    out of focus in the same way.

    Parameters
    ----------
    psfs : torch.Tensor or numpy.ndarray
        (surfaces, rows, columns), with the origin at n // 2, from the nearest surface on.
    visibility : torch.Tensor or numpy.ndarray
        (surfaces, rows, columns): the share of each place at which each surface is seen. The shares
        add up to 1.

    Attributes
    ----------
    transfers : torch.Tensor
        The PSFs' rfft2.
    coverage : torch.Tensor
        a_k, (surfaces, rows, columns).
    transmission : torch.Tensor
        t_k, (surfaces, rows, columns).

    Raises
    ------
    ValueError
        Unless there are as many PSFs as surfaces, all finite.

    References
    ----------
    S. W. Hasinoff and K. N. Kutulakos, 2007, doi 10.1109/ICCV.2007.4409001.
    """

    @accepts_numpy
    def __init__(self, psfs: torch.Tensor, visibility: torch.Tensor) -> None:
        require_matching_psfs(psfs, "visibility", visibility, "surfaces")
        psfs, visibility = as_floating_point(psfs), as_floating_point(visibility)
        self.shape = (int(visibility.shape[-2]), int(visibility.shape[-1]))
        self.transfers = transfer_function(psfs, self.shape)
        self.coverage = visibility.cumsum(0).clamp(0, 1)
        shares = psfs.sum((-2, -1), keepdim=True)
        hidden = irfft2(rfft2(self.coverage) * self.transfers, self.shape) / shares
        past = torch.ones_like(hidden)
        past[1:] = (1 - hidden[:-1]).clamp(0, 1).cumprod(0)
        self.transmission = past
        self.domain, self.codomain = tuple(visibility.shape), self.shape

    def _forward(self, x: torch.Tensor) -> torch.Tensor:
        light = irfft2(rfft2(x * self.coverage) * self.transfers, self.shape)
        return (light * self.transmission).sum(-3)

    def _adjoint(self, y: torch.Tensor) -> torch.Tensor:
        spectra = rfft2(y[..., None, :, :] * self.transmission) * self.transfers.conj()
        return irfft2(spectra, self.shape) * self.coverage

    @property
    def bytes(self) -> int:
        """The bytes that one call takes besides its input and its output."""
        return 3 * self.transfers.nelement() * self.transfers.element_size()
