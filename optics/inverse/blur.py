"""Blur by one PSF, by PSFs that vary, or where surfaces hide others."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import torch

from optics.fourier import fast_fft_length, fft, irfft2, rfft, rfft2
from optics.inverse.operator import Domain, Operator
from optics.inverse.pixel_operators import CentredCrop
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
        """The memory in bytes that one call needs besides input and output."""
        return 3 * self.transfer.nelement() * self.transfer.element_size()

    @property
    def diagonal(self) -> tuple[Domain, torch.Tensor]:
        """The transfer function, by which the frequencies are multiplied."""
        return "frequencies", self.transfer


@accepts_numpy
def transfer_function(psf: torch.Tensor, shape: Sequence[int]) -> torch.Tensor:
    """Compute the rfft2 of a PSF on `shape`, with its origin moved from n // 2 to index 0.

    The zero rows around the PSF aren't transformed. For a small PSF this saves nearly half of the
    time.
    """
    across = rfft(_wrap_axis(psf, -1, int(shape[1])))
    return fft(_wrap_axis(across, -2, int(shape[0])), int(shape[0]), -2, overwrite=True)


def _wrap_axis(psf: torch.Tensor, dim: int, period: int) -> torch.Tensor:
    """Wrap a PSF around the period along one axis, with its origin moved from n // 2 to index 0."""
    length = psf.shape[dim]
    place = (torch.arange(length, device=psf.device) - length // 2) % period
    sizes = list(psf.shape)
    sizes[dim] = period
    return psf.new_zeros(sizes).index_add_(dim, place, psf)


def blur_shape(frame: Sequence[int], psf: Sequence[int]) -> tuple[int, int]:
    """Compute the shape of a period on which a blur doesn't wrap light around the frame.

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
    rows, columns = int(frame[-2]) + int(psf[-2]), int(frame[-1]) + int(psf[-1])
    return fast_fft_length(rows), fast_fft_length(columns)


def require_border(border: str) -> None:
    """Raise ValueError unless `border` is one of BORDERS."""
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


class VaryingBlur(Operator):
    """Blurs a picture by PSFs that vary over it: y = sum_k h_k * (w_k x).

    Parameters
    ----------
    psfs : torch.Tensor or numpy.ndarray
        (PSFs, rows, columns), with the origin at n // 2.
    weights : torch.Tensor or numpy.ndarray
        (PSFs, rows, columns): the share of each pixel's light that each PSF spreads. Where the
        weights of a pixel add up to 1, its PSF is the weighted mean of all PSFs. See
        `field_weights` for PSFs that vary over the field and `layer_weights` for depth layers.

    Raises
    ------
    ValueError
        If the numbers of PSFs and weights differ, or if a value isn't finite.
    """

    @accepts_numpy
    def __init__(self, psfs: torch.Tensor, weights: torch.Tensor) -> None:
        require_matching_psfs(psfs, "weights", weights, "PSFs")
        self.weights = as_floating_point(weights)
        self.shape = (int(weights.shape[-2]), int(weights.shape[-1]))
        self.transfers = transfer_function(as_floating_point(psfs), self.shape)
        self.domain = self.codomain = self.shape

    def _forward(self, x: torch.Tensor) -> torch.Tensor:
        spectra = rfft2(x[..., None, :, :] * self.weights) * self.transfers
        return irfft2(spectra.sum(-3), self.shape)

    def _adjoint(self, y: torch.Tensor) -> torch.Tensor:
        spectra = rfft2(y)[..., None, :, :] * self.transfers.conj()
        return (irfft2(spectra, self.shape) * self.weights).sum(-3)

    @property
    def bytes(self) -> int:
        """The memory in bytes that one call needs besides input and output."""
        return 3 * self.transfers.nelement() * self.transfers.element_size()


def require_matching_psfs(psfs: torch.Tensor, name: str, shares: torch.Tensor, each: str) -> None:
    """Raise ValueError unless there are as many pictures of `each` as PSFs, all of them finite."""
    require_finite("psfs", psfs)
    require_finite(name, shares)
    if psfs.ndim != 3 or shares.ndim != 3 or len(psfs) != len(shares):
        raise ValueError(
            f"psfs are {tuple(psfs.shape)} and {name} {tuple(shares.shape)}; give as many of both, "
            f"({each}, rows, columns)"
        )


def field_weights(
    shape: Sequence[int], rows: Sequence[float], columns: Sequence[float]
) -> torch.Tensor:
    """Compute the bilinear weights of PSFs that are known on a grid of positions.

    Parameters
    ----------
    shape : sequence of int
        The picture's (rows, columns).
    rows : sequence of float
        The grid's row positions in pixels, increasing.
    columns : sequence of float
        The grid's column positions in pixels, increasing. Pixels beyond the outermost positions
        take the PSFs of the nearest ones.

    Returns
    -------
    torch.Tensor
        ``(PSFs, *shape)``, with the PSFs in the order of the grid's rows. The weights of each pixel
        add up to 1.

    Raises
    ------
    ValueError
        For positions that don't increase.
    """
    down, along = (
        _hat_functions(int(shape[0]), "rows", rows),
        _hat_functions(int(shape[1]), "columns", columns),
    )
    return (down[:, None, :, None] * along[None, :, None, :]).reshape(
        -1, int(shape[0]), len(along.T)
    )


def _hat_functions(n: int, name: str, places: Sequence[float]) -> torch.Tensor:
    """Compute the weights of linear interpolation along one axis, (places, n) for n pixels."""
    knots = torch.as_tensor(list(places), dtype=torch.float64)
    if not len(knots) or not bool((knots.diff() > 0).all()):
        raise ValueError(f"{name} are {list(places)}; give places that increase")
    at = torch.arange(n, dtype=torch.float64).clamp(knots[0], knots[-1])
    if len(knots) == 1:
        return torch.ones(1, n)
    after = torch.searchsorted(knots, at, right=True).clamp(1, len(knots) - 1)
    share = (at - knots[after - 1]) / (knots[after] - knots[after - 1])
    hats = torch.zeros(len(knots), n, dtype=torch.float64)
    index = torch.arange(n)
    hats[after - 1, index] = 1 - share
    hats[after, index] += share
    return hats.to(torch.float32)


@accepts_numpy
def layer_weights(layers: torch.Tensor, count: int) -> torch.Tensor:
    """Convert a map of depth layers to the weights of a VaryingBlur.

    Parameters
    ----------
    layers : torch.Tensor or numpy.ndarray
        Number of the layer that each pixel shows, (rows, columns), whole and from 0.
    count : int
        The number of layers.

    Returns
    -------
    torch.Tensor or numpy.ndarray
        (count, rows, columns), 1 where a pixel shows the layer, else 0.

    Raises
    ------
    ValueError
        For numbers that aren't whole or lie outside 0 to `count` - 1.
    """
    if layers.is_floating_point() and bool((layers != layers.round()).any()):
        raise ValueError("layers has fractions; give the whole number of each pixel's layer")
    least, most = int(layers.min()), int(layers.max())
    if least < 0 or most >= count:
        raise ValueError(f"layers go from {least} to {most}; with {count} they go from 0")
    return torch.stack([(layers == k).to(torch.float32) for k in range(count)])


class OccludingBlur(Operator):
    """Blurs surfaces at several depths, each of which hides what lies behind it, and adds them.

    y = sum_k t_k (h_k * (a_k x_k)), where x is (surfaces, rows, columns) and h_k is the PSF of
    surface k. Each surface continues behind those that hide it, with the coverage a_k = sum of
    visibility_j over j up to k. Surface j transmits 1 - h_j * a_j, and t_k is the product of the
    transmissions of all surfaces in front of k.

    A hidden point is taken to be hidden from all rays of a pixel alike. This is exact where the
    surface behind is in focus (Hasinoff and Kutulakos 2007). Where both are out of focus in the
    same way, too much light comes past the edge.

    Parameters
    ----------
    psfs : torch.Tensor or numpy.ndarray
        (surfaces, rows, columns), with the origin at n // 2; the nearest surface comes first.
    visibility : torch.Tensor or numpy.ndarray
        (surfaces, rows, columns): the share of each pixel in which each surface is seen. The
        shares of a pixel add up to 1.

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
        """The memory in bytes that one call needs besides input and output."""
        return 3 * self.transfers.nelement() * self.transfers.element_size()
