"""Operators on single pixels: a crop, a mask, and a mosaic of colour filters."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from optics.inverse.operator import Domain, GramOperator, Operator
from optics.plane import centred_crop, centred_pad
from optics.validation import accepts_numpy, as_floating_point, require_finite


class CentredCrop(Operator):
    """Crops the middle of a larger picture, as a frame shows only part of the scene.

    The transpose pads a picture with zeros.

    Parameters
    ----------
    whole : sequence of int
        (rows, columns) of the larger picture.
    shape : sequence of int
        (rows, columns) of the crop, no larger than `whole`.
    bands : sequence of int, optional
        Lengths of the axes before rows and columns; none by default.

    Raises
    ------
    ValueError
        If `shape` is larger than `whole`.
    """

    def __init__(
        self, whole: Sequence[int], shape: Sequence[int], bands: Sequence[int] = ()
    ) -> None:
        self._whole, self._shape = (tuple(map(int, one)) for one in (whole, shape))
        if any(n > m for n, m in zip(self._shape, self._whole, strict=True)):
            raise ValueError(f"shape is {self._shape}; a window of {self._whole} is no larger")
        self.domain = (*bands, *self._whole)
        self.codomain = (*bands, *self._shape)

    def _forward(self, x: torch.Tensor) -> torch.Tensor:
        return centred_crop(x, self._shape)

    def _adjoint(self, y: torch.Tensor) -> torch.Tensor:
        return centred_pad(y, self._whole)

    @property
    def bytes(self) -> int:
        """The memory in bytes that one call needs besides input and output: none."""
        return 0

    @property
    def gram(self) -> GramOperator:
        """A^T A, which is diagonal in pixels."""
        inside = centred_pad(torch.ones(self._shape), self._whole)
        return GramOperator("pixels", inside, (self._whole[0], self._whole[1]))

    def gram_with(self, then: GramOperator) -> GramOperator | None:
        """Return A^T (B^T B) A with this crop A, where B acts on pixels."""
        if then.domain == "frequencies":
            return None
        shape = self._whole[0], self._whole[1]
        return GramOperator(then.domain, centred_pad(then.weights, self._whole), shape)


class Mask(Operator):
    """Multiplies each pixel of a picture by a weight.

    Parameters
    ----------
    weights : torch.Tensor or numpy.ndarray
        (rows, columns), or (bands, rows, columns), finite. For example 0 where a pixel is dead or
        clipped and 1 elsewhere, or the share of the light that each pixel gets.

    Raises
    ------
    ValueError
        For weights that aren't finite.
    """

    @accepts_numpy
    def __init__(self, weights: torch.Tensor) -> None:
        require_finite("weights", weights)
        self.weights = weights if weights.is_floating_point() else weights.to(torch.float32)
        self.domain = self.codomain = tuple(weights.shape)

    def _forward(self, x: torch.Tensor) -> torch.Tensor:
        return x * self.weights

    def _adjoint(self, y: torch.Tensor) -> torch.Tensor:
        return y * self.weights

    @property
    def bytes(self) -> int:
        """The memory in bytes that one call needs besides input and output: none."""
        return 0

    @property
    def diagonal(self) -> tuple[Domain, torch.Tensor]:
        """The weights, by which the pixels are multiplied."""
        return "pixels", self.weights


class SpectralMosaic(Operator):
    """Adds all spectral bands at each pixel of a sensor, y = sum_n S_n x_n (thesis Eq. 4.1).

    Parameters
    ----------
    weights : torch.Tensor or numpy.ndarray
        S, (bands, rows, columns): the share of each band that each pixel's filter transmits. See
        `filter_weights`.

    Raises
    ------
    ValueError
        For weights that aren't finite or don't have three axes.
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
        """The memory in bytes that one call needs besides input and output."""
        return self.weights.nelement() * self.weights.element_size()

    @property
    def gram(self) -> GramOperator:
        """A^T A, which is an outer product over the bands at each pixel."""
        return GramOperator("bands", self.weights, (self.domain[-2], self.domain[-1]))


@accepts_numpy
def filter_weights(
    pattern: Sequence[str], response: torch.Tensor, channels: str, shape: Sequence[int]
) -> torch.Tensor:
    """Repeat a pattern of colour filters over a picture, and return what each pixel transmits.

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
