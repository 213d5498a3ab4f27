"""A scene's bands seen through a mosaic of colour filters."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from optics.operators.base import Operator
from optics.operators.gram import GramOperator
from optics.validation import accepts_numpy, as_floating_point, require_finite


class SpectralMosaic(Operator):
    """One number a pixel from all bands: y = sum_n S_n x_n (thesis Eq. 4.1).

    weights: S, (bands, rows, columns), what each pixel's filter lets through of each band; see
    filter_weights().
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
        return self.weights.nelement() * self.weights.element_size()

    @property
    def gram(self) -> GramOperator:
        return GramOperator("bands", self.weights, (self.domain[-2], self.domain[-1]))


@accepts_numpy
def filter_weights(
    pattern: Sequence[str], response: torch.Tensor, channels: str, shape: Sequence[int]
) -> torch.Tensor:
    """(bands, rows, columns) of a pattern of filters that repeats from the first pixel on.

    pattern: rows of one letter a pixel, as ("RG", "GB"). response: (channels, bands), of each
    letter of `channels`. Raises ValueError for a letter without a response.
    """
    missing = sorted({letter for row in pattern for letter in row} - set(channels))
    if missing:
        raise ValueError(f"pattern has {', '.join(missing)}; channels {channels!r} don't")
    places = torch.tensor([[channels.index(letter) for letter in row] for row in pattern])
    rows, columns = int(shape[0]), int(shape[1])
    down = torch.arange(rows) % places.shape[0]
    along = torch.arange(columns) % places.shape[1]
    return as_floating_point(response).mT[:, places[down][:, along]]
