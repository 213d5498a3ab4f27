"""The forward operator of a sensor that sees a scene's bands through a mosaic of colour filters."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from optics.operators.base import Operator
from optics.operators.gram import GramOperator
from optics.validation import accepts_numpy, as_floating_point, require_finite


class SpectralMosaic(Operator):
    """Adds all spectral bands to one value at each pixel of a sensor, y = sum_n S_n x_n.

    Parameters
    ----------
    weights : torch.Tensor or numpy.ndarray
        S, (bands, rows, columns): the share of each band that each pixel's filter transmits. See
        `filter_weights`.

    Raises
    ------
    ValueError
        For weights that aren't finite or don't have three axes.

    References
    ----------
    Thesis Eq. 4.1.
    """

    @accepts_numpy
    def __init__(self, weights: torch.Tensor) -> None:
        require_finite("weights", weights)
        if weights.ndim != 3:
            raise ValueError(f"weights is {tuple(weights.shape)}; give (bands, rows, columns)")
        self.weights = as_floating_point(weights)
        self.domain = tuple(weights.shape)
        self.codomain = self.domain[1:]

    def _forward(self, x: torch.Tensor) -> torch.Tensor:
        return (x * self.weights).sum(-3)

    def _adjoint(self, y: torch.Tensor) -> torch.Tensor:
        return y[..., None, :, :] * self.weights

    @property
    def bytes(self) -> int:
        """The memory in bytes that one call of the mosaic operator needs.

        The input and the output aren't counted.
        """
        return self.weights.nelement() * self.weights.element_size()

    @property
    def gram(self) -> GramOperator:
        """The mosaic operator's A^T A, which is an outer product over the bands at each pixel."""
        return GramOperator("bands", self.weights, (self.domain[-2], self.domain[-1]))


@accepts_numpy
def filter_weights(
    pattern: Sequence[str], response: torch.Tensor, channels: str, shape: Sequence[int]
) -> torch.Tensor:
    """Compute the weights of the mosaic operator from a repeated pattern of colour filters.

    The pattern repeats from the first pixel on.

    Parameters
    ----------
    pattern : sequence of str
        Rows of one letter for each pixel, such as ("RG", "GB").
    response : torch.Tensor or numpy.ndarray
        (channels, bands): the share of each band that each letter's filter transmits.
    channels : str
        The letters, in the order of `response`.
    shape : sequence of int
        The picture's (rows, columns).

    Returns
    -------
    torch.Tensor or numpy.ndarray
        The weights for SpectralMosaic, (bands, rows, columns).

    Raises
    ------
    ValueError
        For a letter without a response.
    """
    missing = sorted({letter for row in pattern for letter in row} - set(channels))
    if missing:
        raise ValueError(f"pattern has {', '.join(missing)}; channels {channels!r} don't")
    places = torch.tensor([[channels.index(letter) for letter in row] for row in pattern])
    rows, columns = int(shape[0]), int(shape[1])
    down = torch.arange(rows) % places.shape[0]
    along = torch.arange(columns) % places.shape[1]
    return as_floating_point(response).mT[:, places[down][:, along]]
