"""Differentiable terms of a restoration's objective, each with its gradient."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch

from optics.operators.base import Operator

SmoothPrior = Literal["total variation", "gradient", "tikhonov"]

SMOOTH_PRIORS: tuple[SmoothPrior, ...] = ("total variation", "gradient", "tikhonov")

ValueAndGradient = tuple[torch.Tensor, torch.Tensor]
"""The value of an objective, and its gradient."""


@dataclass(frozen=True, eq=False)
class Misfit:
    """The data term of a restoration: half the weighted sum of (A x - y)².

    A clipped pixel counts only where A x is below y, since its light is at least y.
    `pixel_weights` are 1 everywhere if None.
    """

    operator: Operator
    data: torch.Tensor
    pixel_weights: torch.Tensor | None = None
    clipped: torch.Tensor | None = None

    def __call__(self, x: torch.Tensor) -> ValueAndGradient:
        left = self.operator(x).sub_(self.data)
        if self.clipped is not None:
            left = torch.where(self.clipped, left.clamp(max=0), left)
        pull = left if self.pixel_weights is None else left * self.pixel_weights
        return (left * pull).sum() / 2, self.operator.adjoint(pull)


@dataclass(frozen=True, eq=False)
class Smoothness:
    """The prior's penalty of a restoration within bounds, for each band of a picture.

    "tikhonov" is half the sum of x², and "gradient" is half the sum of |∇x|². "total variation" is
    the sum of √(|∇x|² + smoothing²) - smoothing, which is below the sum of |∇x| by at most
    `smoothing` per pixel. `periodic` says whether a picture's opposite edges are neighbours.
    Pictures are (..., rows, columns).
    """

    prior: SmoothPrior
    smoothing: float
    periodic: bool

    def __call__(self, x: torch.Tensor) -> ValueAndGradient:
        if self.prior == "tikhonov":
            return x.square().sum() / 2, x
        down, along = differences(x, self.periodic)
        squares = down.square() + along.square()
        if self.prior == "gradient":
            return squares.sum() / 2, differences_adjoint(down, along)
        length = squares.add_(self.smoothing**2).sqrt_()
        value = (length - self.smoothing).sum()
        return value, differences_adjoint(down / length, along / length)


def differences(x: torch.Tensor, periodic: bool) -> tuple[torch.Tensor, torch.Tensor]:
    """Compute a picture's forward differences, on which a deconvolution's prior acts.

    Returns the differences down the columns and those along the rows. In the last row and column
    they are 0, or for a periodic picture the differences to the first row and column.
    """
    down, along = x.roll(-1, -2).sub_(x), x.roll(-1, -1).sub_(x)
    if not periodic:
        down[..., -1, :] = 0
        along[..., -1] = 0
    return down, along


def differences_adjoint(down: torch.Tensor, along: torch.Tensor) -> torch.Tensor:
    """Apply the adjoint of the forward differences on which a deconvolution's prior acts."""
    return down.roll(1, -2).sub_(down).add_(along.roll(1, -1)).sub_(along)
