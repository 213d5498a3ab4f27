"""Smooth objectives of restorations, each with its gradient."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch

from optics.operators.base import Operator

SmoothPrior = Literal["total variation", "gradient", "tikhonov"]

SMOOTH_PRIORS: tuple[SmoothPrior, ...] = ("total variation", "gradient", "tikhonov")

ValueAndGradient = tuple[torch.Tensor, torch.Tensor]
"""A number, and its gradient."""


@dataclass(frozen=True, eq=False)
class Misfit:
    """Half the sum of (A x - y)², each pixel by its trust; of a clipped one only what falls short
    of y, for there the light is at least that. pixel_weights: 1 everywhere if None."""

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
    """What pictures, (..., rows, columns), are asked to be, band by band.

    "tikhonov", half the sum of x²; "gradient", half that of |∇x|²; "total variation", the sum of
    √(|∇x|² + smoothing²) - smoothing: below |∇x| by no more than `smoothing` a pixel. periodic:
    whether a picture's opposite edges are neighbours.
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
    """Forward ones, down and along; at the last row and column 0, or around to the first."""
    down, along = x.roll(-1, -2).sub_(x), x.roll(-1, -1).sub_(x)
    if not periodic:
        down[..., -1, :] = 0
        along[..., -1] = 0
    return down, along


def differences_adjoint(down: torch.Tensor, along: torch.Tensor) -> torch.Tensor:
    return down.roll(1, -2).sub_(down).add_(along.roll(1, -1)).sub_(along)
