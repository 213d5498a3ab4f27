"""The operator A^T A of a forward operator A, in the cases that have a closed form."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch

from optics.fourier import irfft2, rfft2

Domain = Literal["pixels", "frequencies", "bands"]


@dataclass(frozen=True, eq=False)
class GramOperator:
    """The operator A^T A of a forward operator A, where it is diagonal or an outer product.

    Parameters
    ----------
    domain : {"pixels", "frequencies", "bands"}
        "pixels": each pixel is multiplied by its weight. "frequencies": each coefficient of the
        picture's rfft2 is multiplied by its weight. "bands": at each pixel, the bands are
        multiplied by the outer product of the pixel's weights with themselves.
    weights : torch.Tensor
        The weights: (..., rows, columns) for "pixels", (..., rows, columns // 2 + 1) for
        "frequencies", (bands, rows, columns) for "bands".
    shape : tuple of int
        The picture's (rows, columns).
    """

    domain: Domain
    weights: torch.Tensor
    shape: tuple[int, int]

    @property
    def largest_eigenvalue(self) -> float:
        """The largest eigenvalue of the operator A^T A."""
        weights = self._squares if self.domain == "bands" else self.weights
        return float(weights.max())

    @property
    def _squares(self) -> torch.Tensor:
        """The squared weights of the operator A^T A at each pixel, summed over the bands."""
        return self.weights.square().sum(-3)

    def __call__(self, x: torch.Tensor) -> torch.Tensor:
        """Apply the operator A^T A to `x`."""
        if self.domain == "frequencies":
            return irfft2(rfft2(x) * self.weights, self.shape)
        if self.domain == "pixels":
            return x * self.weights
        return self.weights * (self.weights * x).sum(-3, keepdim=True)

    def solve_shifted(self, y: torch.Tensor, shift: float) -> torch.Tensor:
        """Solve (A^T A + shift) x = y for x, with A a forward operator.

        Parameters
        ----------
        y : torch.Tensor
            The right-hand side, of the shape of x.
        shift : float
            A positive number.

        Returns
        -------
        torch.Tensor
            The solution x.

        Raises
        ------
        ValueError
            If `shift` isn't positive.
        """
        if not shift > 0:
            raise ValueError(f"shift is {shift:g}; it must be positive for an inverse to exist")
        if self.domain == "frequencies":
            return irfft2(rfft2(y) / (self.weights + shift), self.shape)
        if self.domain == "pixels":
            return y / (self.weights + shift)
        # The Sherman-Morrison formula inverts an outer product plus a multiple of the identity.
        along = (self.weights * y).sum(-3, keepdim=True)
        return (y - self.weights * along / (self._squares + shift)[..., None, :, :]) / shift
