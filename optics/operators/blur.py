"""The forward operator of a blur by a PSF that is the same everywhere in the picture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import torch

from optics.fourier import fast_fft_length, fft, irfft2, rfft, rfft2
from optics.operators.base import Operator
from optics.operators.crop_and_mask import CentredCrop
from optics.operators.gram import Domain
from optics.validation import accepts_numpy, as_floating_point, require_finite

Border = Literal["unknown", "dark", "periodic"]

BORDERS: tuple[Border, ...] = ("unknown", "dark", "periodic")


class Blur(Operator):
    """The convolution of a picture with a PSF, with periodic borders.

    It computes in single precision, or in double where the PSF is in double.

    Parameters
    ----------
    psf : torch.Tensor or numpy.ndarray
        (..., rows, columns), with the origin at n // 2. Leading axes hold one PSF per band. A PSF
        larger than the picture is wrapped around it.
    shape : sequence of int
        The picture's (rows, columns).

    Attributes
    ----------
    shape : tuple of int
        The picture's (rows, columns).
    transfer : torch.Tensor
        The rfft2 of the PSF on that shape, complex.

    Raises
    ------
    ValueError
        For a PSF that isn't finite.
    """

    @accepts_numpy
    def __init__(self, psf: torch.Tensor, shape: Sequence[int]) -> None:
        require_finite("psf", psf)
        psf = as_floating_point(psf)
        self.shape = (int(shape[0]), int(shape[1]))
        self.transfer = transfer_function(psf, self.shape)
        self.domain = self.codomain = (*psf.shape[:-2], *self.shape)

    def _forward(self, x: torch.Tensor) -> torch.Tensor:
        return irfft2(rfft2(x) * self.transfer, self.shape)

    def _adjoint(self, y: torch.Tensor) -> torch.Tensor:
        return irfft2(rfft2(y) * self.transfer.conj(), self.shape)

    @property
    def bytes(self) -> int:
        """The memory in bytes that one call of the blur operator needs.

        The input and the output aren't counted.
        """
        return 3 * self.transfer.nelement() * self.transfer.element_size()

    @property
    def diagonal(self) -> tuple[Domain, torch.Tensor]:
        """The blur operator's transfer function, by which it multiplies the frequencies."""
        return "frequencies", self.transfer


@accepts_numpy
def transfer_function(psf: torch.Tensor, shape: Sequence[int]) -> torch.Tensor:
    """Compute the transfer function of a blur operator from its PSF.

    The PSF has its origin at n // 2. The result is the PSF's rfft2 on `shape`. The zero rows around
    the PSF aren't transformed. For a small PSF this saves nearly half of the time.
    """
    across = rfft(_wrap_axis(psf, -1, int(shape[1])))
    return fft(_wrap_axis(across, -2, int(shape[0])), int(shape[0]), -2, overwrite=True)


def _wrap_axis(psf: torch.Tensor, dim: int, period: int) -> torch.Tensor:
    """Wrap a blur operator's PSF around the period along one axis.

    The PSF's origin moves from n // 2 to index 0.
    """
    length = psf.shape[dim]
    place = (torch.arange(length, device=psf.device) - length // 2) % period
    sizes = list(psf.shape)
    sizes[dim] = period
    return psf.new_zeros(sizes).index_add_(dim, place, psf)


def blur_shape(frame: Sequence[int], psf: Sequence[int]) -> tuple[int, int]:
    """Compute the shape of a period on which a blur operator doesn't wrap light around.

    The period holds the frame and half a PSF on every side, and its FFTs are fast.

    Parameters
    ----------
    frame : sequence of int
        The frame's shape; the last two numbers are rows and columns.
    psf : sequence of int
        The PSF's shape; the last two numbers are rows and columns.

    Returns
    -------
    tuple of int
        (rows, columns) of the period.
    """
    rows, columns = (
        fast_fft_length(int(n) + int(m)) for n, m in zip(frame[-2:], psf[-2:], strict=True)
    )
    return rows, columns


def require_border(border: str) -> None:
    """Raise ValueError unless `border` names a border of the blur operator, one of BORDERS."""
    if border not in BORDERS:
        raise ValueError(f"border is {border!r}; take one of {', '.join(BORDERS)}")


@accepts_numpy
def blur_operator(psf: torch.Tensor, frame: Sequence[int], border: Border) -> Operator:
    """Build the forward operator that blurs a scene by a PSF and crops it to the frame.

    Parameters
    ----------
    psf : torch.Tensor or numpy.ndarray
        (..., rows, columns), with the origin at n // 2.
    frame : sequence of int
        The frame's (rows, columns).
    border : {"unknown", "dark", "periodic"}
        "unknown": the scene continues beyond the frame, and the operator's domain is the period
        given by `blur_shape`. "dark": there is no light beyond the frame. "periodic": opposite
        edges of the frame are neighbours, as for Blur.

    Returns
    -------
    Operator
        The map from the scene, (..., rows, columns), to the frame.

    Raises
    ------
    ValueError
        For another border, or for a PSF that isn't finite.
    """
    require_border(border)
    if border == "periodic":
        return Blur(psf, frame)
    whole = blur_shape(frame, psf.shape)
    window = CentredCrop(whole, frame, psf.shape[:-2])
    spread = window @ Blur(psf, whole)
    return spread if border == "unknown" else spread @ window.T
