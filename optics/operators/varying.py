"""A picture's light spread by PSFs that differ from place to place."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from optics.fourier import irfft2, rfft2
from optics.operators.base import Operator
from optics.operators.blur import transfer_function
from optics.validation import accepts_numpy, as_floating_point, require_finite


class VaryingBlur(Operator):
    """The sum of pictures that are each weighted, then blurred by a PSF: y = sum_k h_k * (w_k x).

    Parameters
    ----------
    psfs : torch.Tensor or numpy.ndarray
        (PSFs, rows, columns), with the origin at n // 2.
    weights : torch.Tensor or numpy.ndarray
        (PSFs, rows, columns) of the picture: the share of each place's light that each PSF spreads.
        Where they add up to 1, a place's PSF is the mixture of them. See `field_weights` for fields
        and `layer_weights` for depths.

    Raises
    ------
    ValueError
        Unless there are as many PSFs as weights, all finite.
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
        """The bytes that one call takes besides its input and its output."""
        return 3 * self.transfers.nelement() * self.transfers.element_size()


def require_matching_psfs(psfs: torch.Tensor, name: str, shares: torch.Tensor, each: str) -> None:
    """Raise ValueError unless there is a finite picture for each finite PSF. each: what they are
    of, in a word."""
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
    """Compute bilinear weights of PSFs that are known on a grid of places.

    Parameters
    ----------
    shape : sequence of int
        The picture's (rows, columns).
    rows : sequence of float
        The grid's row positions in pixels, increasing.
    columns : sequence of float
        The grid's column positions in pixels, increasing. Beyond the outermost places their PSFs
        continue.

    Returns
    -------
    torch.Tensor
        (PSFs, *shape), row by row of the grid; the weights of each pixel add up to 1.

    Raises
    ------
    ValueError
        For places that don't increase.
    """
    down, along = (
        _hat_functions(int(shape[0]), "rows", rows),
        _hat_functions(int(shape[1]), "columns", columns),
    )
    return (down[:, None, :, None] * along[None, :, None, :]).reshape(
        -1, int(shape[0]), len(along.T)
    )


def _hat_functions(n: int, name: str, places: Sequence[float]) -> torch.Tensor:
    """(places, n): each 1 at its own place, and straight to 0 at its neighbours'."""
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
    """Compute the weights of a map that says which layer is seen at each pixel.

    Parameters
    ----------
    layers : torch.Tensor or numpy.ndarray
        (rows, columns) of whole numbers from 0.
    count : int
        The number of layers.

    Returns
    -------
    torch.Tensor or numpy.ndarray
        (count, rows, columns), 1 where it is that layer, else 0.

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
