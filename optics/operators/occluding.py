"""The forward operator of a blurred scene with surfaces at several depths that hide each other."""

from __future__ import annotations

import torch

from optics.fourier import irfft2, rfft2
from optics.operators.base import Operator
from optics.operators.blur import transfer_function
from optics.operators.varying import require_matching_psfs
from optics.validation import accepts_numpy, as_floating_point


class OccludingBlur(Operator):
    """Blurs surfaces at several depths, each of which hides what lies behind it, and adds them.

    y = sum_k t_k (h_k * (a_k x_k)), where x is (surfaces, rows, columns) and h_k is the PSF of
    surface k. Each surface continues behind those that hide it, with the coverage a_k = sum of
    visibility_j over j up to k. Surface j transmits 1 - h_j * a_j, and t_k is the product of the
    transmissions of all surfaces in front of k.

    The model assumes that a hidden point is hidden from all rays of a pixel alike. This is exact
    where the surface behind is in focus (Hasinoff and Kutulakos 2007). Where both surfaces are out
    of focus in the same way, the model lets too much light past the edge.

    Parameters
    ----------
    psfs : torch.Tensor or numpy.ndarray
        (surfaces, rows, columns), with the origin at n // 2; the nearest surface comes first.
    visibility : torch.Tensor or numpy.ndarray
        (surfaces, rows, columns): the share of each pixel in which each surface is seen. The
        shares of a pixel add up to 1.

    Attributes
    ----------
    transfers : torch.Tensor
        The rfft2 of the PSFs.
    coverage : torch.Tensor
        Coverage a_k of each surface, (surfaces, rows, columns).
    transmission : torch.Tensor
        Transmission t_k of all that lies in front of each surface, (surfaces, rows, columns).

    Raises
    ------
    ValueError
        If the numbers of PSFs and surfaces differ, or if a value isn't finite.

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
        """The memory in bytes that one call of the occluding blur operator needs.

        The input and the output aren't counted.
        """
        return 3 * self.transfers.nelement() * self.transfers.element_size()
