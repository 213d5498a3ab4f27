"""Gradients of the sharp picture as natural statistics and a kernel tell them, and how surely."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch

from optics.deconvolution.blind.quadratic import (
    Quadratic,
    fast_period,
    padded_spectrum,
    quadratic_of,
)
from optics.deconvolution.blind.statistics import Mixture
from optics.fourier import irfft2, rfft2

_ROUNDS, _SOLVING = 2, 12
"""Times that precisions are renewed for one kernel; steps of conjugate gradients for each."""

_SETTLED = 1e-5
"""Of the squared residual, by which conjugate gradients end."""


@dataclass(frozen=True, eq=False)
class Measured:
    """Gradients of the photograph, (channels, rows, columns), and which are known, 1 or 0, as
    (rows, columns)."""

    gradients: torch.Tensor
    known: torch.Tensor


class Latent:
    """The posterior of the sharp gradients, a normal one for each pixel apart: mean and variance.

    For a kernel, by variational Bayes with a mixture of Gaussians before the data (Levin, Weiss,
    Durand and Freeman 2011, doi 10.1109/CVPR.2011.5995308). The gradients are looked for as far
    around the frame as light comes from into it: nothing is assumed of the border.
    """

    def __init__(self, seen: Measured, prior: Mixture, size: tuple[int, int]) -> None:
        self._seen, self._prior, self._size = seen, prior, size
        channels, rows, columns = seen.gradients.shape
        self._field = rows + size[0] - 1, columns + size[1] - 1
        self._period = fast_period(self._field[0] + size[0] - 1, self._field[1] + size[1] - 1)
        down, along = size[0] - 1, size[1] - 1
        self._frame = (..., slice(down, down + rows), slice(along, along + columns))
        known = seen.known.new_zeros(self._period)
        known[self._frame] = seen.known
        self._known = rfft2(known)
        self.mean = seen.gradients.new_zeros((channels, *self._field))
        y, x = size[0] // 2, size[1] // 2
        self.mean[:, y : y + rows, x : x + columns] = seen.gradients * seen.known
        self.variance = torch.zeros_like(self.mean)

    def update(self, kernel: torch.Tensor, deviation: float) -> None:
        """For a kernel, and the standard deviation of a measured gradient."""
        spectrum, precision = self._spectrum(kernel), deviation**-2
        reached = irfft2(self._known * self._spectrum(kernel.square()).conj(), self._period)
        told = self._cut(reached).clamp(min=0) * precision
        wanted = self._back(self._seen.gradients * self._seen.known, spectrum) * precision

        def normal(x: torch.Tensor) -> torch.Tensor:
            light = self._forward(x, spectrum).mul_(self._seen.known)
            return self._back(light, spectrum).mul_(precision).addcmul_(held, x)

        for _ in range(_ROUNDS):
            held = self._prior.precision(self.mean.square() + self.variance)
            self.variance = (told + held).reciprocal_()
            self.mean = _solved(normal, wanted, self.mean, self.variance)

    def misfit(self, kernel: torch.Tensor) -> float:
        """Mean square of what the mean leaves of the measured gradients."""
        left = self._forward(self.mean, self._spectrum(kernel)) - self._seen.gradients
        known = self._seen.known
        return float((left.square() * known).sum() / (known.sum() * left.shape[0]))

    def problem(self, kernel: torch.Tensor) -> Quadratic:
        """What it says of the kernel. Gradients that weren't measured are taken for what a kernel
        makes of the mean, which makes each step one of expectation and maximisation."""
        spectrum = padded_spectrum(self.mean, self._period)
        light = irfft2(spectrum * self._spectrum(kernel), self._period)
        light[self._frame] = torch.where(
            self._seen.known > 0, self._seen.gradients, light[self._frame]
        )
        share = self._seen.gradients[0].numel() / self.mean[0].numel()
        unsure = float(self.variance.sum()) * share
        return quadratic_of(spectrum, rfft2(light), self._size).ridged(unsure)

    def _spectrum(self, kernel: torch.Tensor) -> torch.Tensor:
        return padded_spectrum(kernel, self._period)

    def _cut(self, whole: torch.Tensor) -> torch.Tensor:
        return whole[..., : self._field[0], : self._field[1]]

    def _forward(self, x: torch.Tensor, spectrum: torch.Tensor) -> torch.Tensor:
        return irfft2(padded_spectrum(x, self._period) * spectrum, self._period)[self._frame]

    def _back(self, light: torch.Tensor, spectrum: torch.Tensor) -> torch.Tensor:
        whole = light.new_zeros((light.shape[0], *self._period))
        whole[self._frame] = light
        return self._cut(irfft2(rfft2(whole) * spectrum.conj(), self._period))


def _solved(
    normal: Callable[[torch.Tensor], torch.Tensor],
    wanted: torch.Tensor,
    start: torch.Tensor,
    inverse: torch.Tensor,
) -> torch.Tensor:
    """By conjugate gradients, with the inverse of the diagonal."""
    x, left = start, wanted - normal(start)
    eased = inverse * left
    way, size = eased, float((left * eased).sum())
    first = size
    for _ in range(_SOLVING):
        if size <= _SETTLED * first or size == 0:
            break
        turned = normal(way)
        step = size / float((way * turned).sum())
        x = x + step * way
        left = left - step * turned
        eased = inverse * left
        before, size = size, float((left * eased).sum())
        way = eased + (size / before) * way
    return x
