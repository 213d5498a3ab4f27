"""Forward operators that act on single pixels: a crop and a mask."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from optics.operators.base import Operator
from optics.operators.gram import Domain, GramOperator
from optics.plane import centred_crop, centred_pad
from optics.validation import accepts_numpy, require_finite


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
        """The memory in bytes that one call of the crop operator needs: none.

        The input and the output aren't counted.
        """
        return 0

    @property
    def gram(self) -> GramOperator:
        """The crop operator's A^T A, which is diagonal in pixels."""
        inside = centred_pad(torch.ones(self._shape), self._whole)
        return GramOperator("pixels", inside, (self._whole[0], self._whole[1]))

    def gram_with(self, then: GramOperator) -> GramOperator | None:
        """Return the Gram operator of B A with this crop operator A, where B acts on pixels."""
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
        """The memory in bytes that one call of the mask operator needs: none.

        The input and the output aren't counted.
        """
        return 0

    @property
    def diagonal(self) -> tuple[Domain, torch.Tensor]:
        """The mask operator's weights, by which it multiplies the pixels."""
        return "pixels", self.weights
