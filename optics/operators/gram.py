"""A^T A of an operator, where something makes it diagonal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch

from optics.fourier import irfft2, rfft2

Domain = Literal["pixels", "frequencies", "bands"]


@dataclass(frozen=True, eq=False)
class GramOperator:
    """The operator A^T A of a forward operator A, where some basis makes it diagonal.

    Parameters
    ----------
    domain : {"pixels", "frequencies", "bands"}
        "pixels": each pixel is multiplied by its weight. "frequencies": the same for a picture's
        rfft2. "bands": at each pixel, the outer product of its weights with themselves.
    weights : torch.Tensor
        The weights, (..., rows, columns) of pixels or of frequencies; (bands, rows, columns) for
        "bands".
    shape : tuple of int
        The picture's (rows, columns).
    """

    domain: Domain
    weights: torch.Tensor
    shape: tuple[int, int]

    @property
    def largest_eigenvalue(self) -> float:
        """The largest eigenvalue of A^T A."""
        weights = self._squares if self.domain == "bands" else self.weights
        return float(weights.max())

    @property
    def _squares(self) -> torch.Tensor:
        return self.weights.square().sum(-3)

    def __call__(self, x: torch.Tensor) -> torch.Tensor:
        """Apply the operator: A^T A x."""
        if self.domain == "frequencies":
            return irfft2(rfft2(x) * self.weights, self.shape)
        if self.domain == "pixels":
            return x * self.weights
        return self.weights * (self.weights * x).sum(-3, keepdim=True)

    def solve_shifted(self, y: torch.Tensor, shift: float) -> torch.Tensor:
        """Solve (A^T A + shift) x = y for x.

        Parameters
        ----------
        y : torch.Tensor
            The right-hand side, of the shape of x.
        shift : float
            A positive number.

        Returns
        -------
        torch.Tensor
            x.

        Raises
        ------
        ValueError
            Unless `shift` is positive.
        """
        if not shift > 0:
            raise ValueError(f"shift is {shift:g}; it must be positive for an inverse to exist")
        if self.domain == "frequencies":
            return irfft2(rfft2(y) / (self.weights + shift), self.shape)
        if self.domain == "pixels":
            return y / (self.weights + shift)
        # Sherman and Morrison's formula.
        along = (self.weights * y).sum(-3, keepdim=True)
        return (y - self.weights * along / (self._squares + shift)[..., None, :, :]) / shift
