"""The forward operator of a blur by PSFs that vary over the picture."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from optics.fourier import irfft2, rfft2
from optics.operators.base import Operator
from optics.operators.blur import transfer_function
from optics.validation import accepts_numpy, as_floating_point, require_finite


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
        """The memory in bytes that one call of the varying blur operator needs.

        The input and the output aren't counted.
        """
        return 3 * self.transfers.nelement() * self.transfers.element_size()


def require_matching_psfs(psfs: torch.Tensor, name: str, shares: torch.Tensor, each: str) -> None:
    """Raise ValueError unless a blur operator gets as many pictures as PSFs, all of them finite.

    `name` names the pictures in the message, and `each` says what they stand for, in the plural.
    """
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
    """Compute a varying blur operator's weights for PSFs that are known on a grid of positions.

    The weights interpolate bilinearly between the positions.

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
    """Compute a varying blur operator's linear interpolation weights along one axis.

    The result is (places, n) for n pixels. Each row is 1 at its own place and falls linearly to 0
    at the neighbouring places.
    """
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
    """Convert a map of depth layers to the weights of a VaryingBlur operator.

    The map has the layer's number at each pixel.

    Parameters
    ----------
    layers : torch.Tensor or numpy.ndarray
        The number of the layer that each pixel shows, (rows, columns), whole numbers from 0.
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
