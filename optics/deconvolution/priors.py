"""What is known of pictures beforehand, each as a split of its own."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

import torch

_ROW_STRIDE = 4
"""Rows of which one is looked at for statistics."""

_EVIDENCE_FACTOR = 0.78
"""Of the weight by the evidence, that restores best: the share of the gradient's freedom that
counts, for of its two components the one along an edge is nearly free."""


def weight_by_evidence(penalty: float, power: float, noise: float, explained_share: float) -> float:
    """Of a penalty that grows with a power of the picture, by the evidence (MacKay 1992, doi
    10.1162/neco.1992.4.3.415): power * weight * penalty = freedom * noise².

    penalty: mean of a pixel. explained_share: share of the data that the picture explains.
    """
    return _EVIDENCE_FACTOR * explained_share * noise**2 / max(power * penalty, 1e-30)


class Prior(ABC):
    """What is asked of D x, with D x split off.

    gram_spectrum: (rows, columns // 2 + 1), D^T D on the frequencies of a period, or a number.
    adjoint_target: D^T (d - b), what the split wants of the next picture, for a coupling of 1; None
    before the first step. It may be the same array each time.
    """

    gram_spectrum: torch.Tensor
    adjoint_target: torch.Tensor | None = None

    @abstractmethod
    def update(self, x: torch.Tensor) -> None:
        """Take the next picture in, (rows, columns)."""

    @abstractmethod
    def coupling(self, weight: float, data: float) -> float:
        """Of the split, for a weight of the penalty and a coupling of the data."""


class Penalty(Prior):
    """A weight times the sum of a penalty of D x."""

    @abstractmethod
    def estimate_weight(self, noise: float, explained_share: float) -> float:
        """That the last picture says the penalty should have, for a noise and for the share of the
        data that it explains: see weight_by_evidence()."""


class TotalVariation(Penalty):
    """The length of the gradient to a power, in all directions alike: 1 for total variation
    (Rudin, Osher and Fatemi 1992, doi 10.1016/0167-2789(92)90242-F), less for the heavier tails of
    natural pictures (Krishnan and Fergus 2009), by Chartrand's shrinkage (2009, doi
    10.1109/ISBI.2009.5192999).

    threshold: length of a gradient that a first iteration takes for none.
    """

    def __init__(
        self, shape: tuple[int, int], threshold: float, power: float, dtype: torch.dtype
    ) -> None:
        self._threshold, self._power = threshold, power
        self.gram_spectrum = laplacian_spectrum(shape).to(dtype)
        self._down, self._along = (torch.zeros(shape, dtype=dtype) for _ in range(2))
        self._size, self._kept = (torch.empty(shape, dtype=dtype) for _ in range(2))
        self._last: torch.Tensor | None = None

    def coupling(self, weight: float, data: float) -> float:
        return self._power * weight / self._threshold ** (2 - self._power)

    def estimate_weight(self, noise: float, explained_share: float) -> float:
        mean = 0.0 if self._last is None else mean_gradient(self._last, self._power)
        return weight_by_evidence(mean, self._power, noise, explained_share)

    def update(self, x: torch.Tensor) -> None:
        self._last = x
        down, along, size, kept = self._down, self._along, self._size, self._kept
        add_gradient(x, down, along)
        torch.mul(down, down, out=size).addcmul_(along, along)
        # The share of it that the penalty takes: all of what is shorter than a step.
        size.rsqrt_().mul_(self._threshold)
        if self._power != 1:
            size.pow_(2 - self._power)
        size.clamp_(max=1)
        # d - b is the gradient less twice that share, and b what it has taken.
        torch.mul(size, -2, out=kept).add_(1)
        wanted = down * kept, along * kept
        down.mul_(size)
        along.mul_(size)
        self.adjoint_target = gradient_adjoint(*wanted, out=kept)


class NonNegativity(Prior):
    """Light is nowhere negative; and nothing shines beyond the frame, where that is known."""

    def __init__(
        self, shape: tuple[int, int], support: torch.Tensor | None, dtype: torch.dtype
    ) -> None:
        self.gram_spectrum = torch.ones((), dtype=dtype)
        self._support = support
        self._dual = torch.zeros(shape, dtype=dtype)

    def coupling(self, weight: float, data: float) -> float:
        return data

    def update(self, x: torch.Tensor) -> None:
        moved = self._dual.add_(x)
        allowed = moved.clamp(min=0)
        if self._support is not None:
            allowed.mul_(self._support)
        self._dual = moved - allowed
        self.adjoint_target = allowed.sub_(self._dual)


def laplacian_spectrum(shape: tuple[int, int]) -> torch.Tensor:
    """The gradient's adjoint times itself, on the frequencies of a period: (rows, columns // 2 + 1)
    in double precision."""
    y = 2 - 2 * torch.cos(2 * math.pi * torch.fft.fftfreq(shape[0], dtype=torch.float64))
    x = 2 - 2 * torch.cos(2 * math.pi * torch.fft.rfftfreq(shape[1], dtype=torch.float64))
    return y[:, None] + x[None, :]


def add_gradient(x: torch.Tensor, down: torch.Tensor, along: torch.Tensor) -> None:
    """Forward differences, around the period, added to what is there."""
    down[:-1].add_(x[1:]).sub_(x[:-1])
    down[-1].add_(x[0]).sub_(x[-1])
    along[:, :-1].add_(x[:, 1:]).sub_(x[:, :-1])
    along[:, -1].add_(x[:, 0]).sub_(x[:, -1])


def gradient_adjoint(down: torch.Tensor, along: torch.Tensor, out: torch.Tensor) -> torch.Tensor:
    """The adjoint of the gradient."""
    torch.add(down, along, out=out).neg_()
    out[1:].add_(down[:-1])
    out[0].add_(down[-1])
    out[:, 1:].add_(along[:, :-1])
    out[:, 0].add_(along[:, -1])
    return out


def mean_gradient(x: torch.Tensor, power: float) -> float:
    """Mean length of the gradient to a power, in every fourth row."""
    rows = x[:-1:_ROW_STRIDE]
    down, along = (x[1::_ROW_STRIDE] - rows)[:, :-1], rows[:, 1:] - rows[:, :-1]
    length = torch.addcmul(along * along, down, down).sqrt_()
    return float((length if power == 1 else length.pow_(power)).mean())


def divergence_of_direction(x: torch.Tensor, smooth: float) -> torch.Tensor:
    """div(∇x / |∇x|), of a gradient whose length is smoothed by a length."""
    down, along = torch.zeros_like(x), torch.zeros_like(x)
    add_gradient(x, down, along)
    length = torch.addcmul(down * down, along, along).add_(smooth**2).rsqrt_()
    return gradient_adjoint(down.mul_(length), along.mul_(length), length).neg_()


def laplacian_of(x: torch.Tensor) -> torch.Tensor:
    """∇²x by differences, around the period."""
    down, along = torch.zeros_like(x), torch.zeros_like(x)
    add_gradient(x, down, along)
    return gradient_adjoint(down, along, torch.empty_like(x)).neg_()
