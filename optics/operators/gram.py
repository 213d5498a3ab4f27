"""A^T A of an operator, where something makes it diagonal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch

from optics.fourier import irfft2, rfft2

Domain = Literal["pixels", "frequencies", "bands"]


@dataclass(frozen=True, eq=False)
class GramOperator:
    """A^T A.

    domain: "pixels", which multiplies each by its weight; "frequencies", the same for a
    picture's rfft2; "bands", the outer product of each pixel's weights, (bands, rows, columns),
    with themselves. shape: of a picture, (rows, columns).
    """

    domain: Domain
    weights: torch.Tensor
    shape: tuple[int, int]

    @property
    def largest_eigenvalue(self) -> float:
        """Eigenvalue."""
        weights = self._squares if self.domain == "bands" else self.weights
        return float(weights.max())

    @property
    def _squares(self) -> torch.Tensor:
        return self.weights.square().sum(-3)

    def __call__(self, x: torch.Tensor) -> torch.Tensor:
        """A^T A x."""
        if self.domain == "frequencies":
            return irfft2(rfft2(x) * self.weights, self.shape)
        if self.domain == "pixels":
            return x * self.weights
        return self.weights * (self.weights * x).sum(-3, keepdim=True)

    def solve_shifted(self, y: torch.Tensor, shift: float) -> torch.Tensor:
        """The x of (A^T A + shift) x = y; ValueError unless `shift` is positive."""
        if not shift > 0:
            raise ValueError(f"shift is {shift:g}; it must be positive for an inverse to exist")
        if self.domain == "frequencies":
            return irfft2(rfft2(y) / (self.weights + shift), self.shape)
        if self.domain == "pixels":
            return y / (self.weights + shift)
        # Sherman and Morrison's formula.
        along = (self.weights * y).sum(-3, keepdim=True)
        return (y - self.weights * along / (self._squares + shift)[..., None, :, :]) / shift
