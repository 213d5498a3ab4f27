"""Derivatives of periodic pictures, which the priors of restorations penalise."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence

import torch


class Derivative(ABC):
    """Base class of the derivatives of periodic pictures that a deconvolution's prior penalises.

    Pictures are (..., rows, columns). `parts` is the number of pictures that make up a derivative.
    """

    parts: int

    @abstractmethod
    def gram_spectrum(self, shape: tuple[int, int]) -> torch.Tensor:
        """Return a derivative's adjoint times the derivative, as factors of frequencies.

        The factors, for a deconvolution's prior, are on the rfft2 grid of a period, in double
        precision.
        """

    @abstractmethod
    def add(self, x: torch.Tensor, parts: Sequence[torch.Tensor], factor: float = 1.0) -> None:
        """Add a deconvolved picture's derivative, times a factor, to `parts` in place."""

    @abstractmethod
    def adjoint(self, parts: Sequence[torch.Tensor], out: torch.Tensor) -> torch.Tensor:
        """Apply the derivative's adjoint to a deconvolution prior's split; write it to `out`."""


class _Gradient(Derivative):
    """The gradient of a deconvolved picture: forward differences down columns and along rows."""

    parts = 2

    def gram_spectrum(self, shape: tuple[int, int]) -> torch.Tensor:
        return laplacian_spectrum(shape)

    def add(self, x: torch.Tensor, parts: Sequence[torch.Tensor], factor: float = 1.0) -> None:
        down, along = parts
        add_gradient(x, down, along, factor)

    def adjoint(self, parts: Sequence[torch.Tensor], out: torch.Tensor) -> torch.Tensor:
        down, along = parts
        return gradient_adjoint(down, along, out)


class _Curvature(Derivative):
    """The second differences of a deconvolved picture.

    They go down the columns, along the rows, and across both, times √2. Together they don't depend
    on the direction.
    """

    parts = 3

    def gram_spectrum(self, shape: tuple[int, int]) -> torch.Tensor:
        return laplacian_spectrum(shape).square()

    def add(self, x: torch.Tensor, parts: Sequence[torch.Tensor], factor: float = 1.0) -> None:
        down, along = torch.zeros_like(x), torch.zeros_like(x)
        add_gradient(x, down, along, factor)
        twice_down, twice_along, across = parts
        twice_down.add_(down)
        twice_down[..., 1:, :].sub_(down[..., :-1, :])
        twice_down[..., 0, :].sub_(down[..., -1, :])
        twice_along.add_(along)
        twice_along[..., 1:].sub_(along[..., :-1])
        twice_along[..., 0].sub_(along[..., -1])
        across[..., :-1].add_(down[..., 1:], alpha=math.sqrt(2))
        across[..., -1].add_(down[..., 0], alpha=math.sqrt(2))
        across.sub_(down, alpha=math.sqrt(2))

    def adjoint(self, parts: Sequence[torch.Tensor], out: torch.Tensor) -> torch.Tensor:
        twice_down, twice_along, across = parts
        down, along = twice_down.clone(), twice_along.clone()
        down[..., :-1, :].sub_(twice_down[..., 1:, :])
        down[..., -1, :].sub_(twice_down[..., 0, :])
        down[..., 1:].add_(across[..., :-1], alpha=math.sqrt(2))
        down[..., 0].add_(across[..., -1], alpha=math.sqrt(2))
        down.sub_(across, alpha=math.sqrt(2))
        along[..., :-1].sub_(twice_along[..., 1:])
        along[..., -1].sub_(twice_along[..., 0])
        return gradient_adjoint(down, along, out)


GRADIENT, CURVATURE = _Gradient(), _Curvature()


def laplacian_spectrum(shape: tuple[int, int]) -> torch.Tensor:
    """Return the spectrum of the negative Laplacian, as a deconvolution's prior uses it.

    The negative Laplacian is the gradient's adjoint times the gradient. The spectrum is on the
    rfft2 grid of a period, (rows, columns // 2 + 1), in double precision.
    """
    y = 2 - 2 * torch.cos(2 * math.pi * torch.fft.fftfreq(shape[0], dtype=torch.float64))
    x = 2 - 2 * torch.cos(2 * math.pi * torch.fft.rfftfreq(shape[1], dtype=torch.float64))
    return y[:, None] + x[None, :]


def add_gradient(
    x: torch.Tensor, down: torch.Tensor, along: torch.Tensor, factor: float = 1.0
) -> None:
    """Add a picture's periodic gradient, for a deconvolution prior, to `down` and `along` in place.

    The gradient consists of forward differences, and is multiplied by a factor.
    """
    plus, minus = {"alpha": factor}, {"alpha": -factor}
    down[..., :-1, :].add_(x[..., 1:, :], **plus).add_(x[..., :-1, :], **minus)
    down[..., -1, :].add_(x[..., 0, :], **plus).add_(x[..., -1, :], **minus)
    along[..., :-1].add_(x[..., 1:], **plus).add_(x[..., :-1], **minus)
    along[..., -1].add_(x[..., 0], **plus).add_(x[..., -1], **minus)


def gradient_adjoint(down: torch.Tensor, along: torch.Tensor, out: torch.Tensor) -> torch.Tensor:
    """Apply the adjoint of a deconvolution prior's periodic gradient; write the result to `out`."""
    torch.add(down, along, out=out).neg_()
    out[..., 1:, :].add_(down[..., :-1, :])
    out[..., 0, :].add_(down[..., -1, :])
    out[..., 1:].add_(along[..., :-1])
    out[..., 0].add_(along[..., -1])
    return out
