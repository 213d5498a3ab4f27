"""Surfaces at several depths, of which each hides what lies behind it."""

from __future__ import annotations

import torch

from optics.fourier import irfft2, rfft2
from optics.operators.base import Operator
from optics.operators.blur import transfer_function
from optics.operators.varying import require_matching_psfs
from optics.validation import accepts_numpy, as_floating_point


class OccludingBlur(Operator):
    """The light of surfaces one behind the other, y = sum_k t_k (h_k * (a_k x_k)).

    psfs: (surfaces, rows, columns), origin at n // 2, from the nearest on. visibility: how much of
    each place is which surface, (surfaces, rows, columns), adding up to 1. Each surface goes on
    behind those that hide it, a_k = sum of visibility_j up to k; and lets past t = 1 - h * a, so
    that t_k is the product of those in front. x is (surfaces, rows, columns).

    What is hidden is so from all rays of a pixel alike: exact where what lies behind is in focus
    (Hasinoff and Kutulakos 2007, doi 10.1109/ICCV.2007.4409001), and too much light gets past an
    edge where both are out of focus in the same way.
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
        return 3 * self.transfers.nelement() * self.transfers.element_size()
