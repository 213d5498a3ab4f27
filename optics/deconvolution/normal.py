"""The linear part of a restoration: (H* M H + K) x = H* M y + K z, on frequencies."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, partial

import torch

from optics.deconvolution.blurred import Blurred
from optics.deconvolution.conjugate import conjugate_gradients
from optics.fourier import half_counts, irfft2, rfft2
from optics.plane import centred_pad

_SOLVED = 1e-5
"""Of the right-hand side, in the preconditioner's norm, that may be left."""


class NormalEquations:
    """Of a photograph less a brightness that is set apart, which no K darkens.

    A period that was seen whole is solved at once, anything else by conjugate gradients that the
    solution for the whole period preconditions.
    """

    def __init__(self, seen: Blurred) -> None:
        self._seen = seen
        self.mean = seen.filled.mean()
        self._count = half_counts(seen.whole[1])

    @cached_property
    def _data(self) -> torch.Tensor:
        """H* M y."""
        return self._measured(centred_pad(self._seen.filled - self.mean, self._seen.whole))

    def start(self, penalty: torch.Tensor) -> torch.Tensor:
        """The solution if the smooth continuation of the photograph had been measured."""
        spectrum = rfft2(self._seen.continued - self.mean).mul_(self._seen.back)
        return spectrum.mul_(self._below(penalty).reciprocal_())

    def solved(
        self,
        penalty: torch.Tensor,
        spectrum: torch.Tensor,
        steps: int,
        near: torch.Tensor | None = None,
    ) -> tuple[torch.Tensor, int]:
        """The spectrum of x, and how many steps it took from the one that is given.

        penalty: K, of each frequency. near: spectrum of z less the brightness; 0 if None.
        """
        if steps == 0 or (self._seen.complete and near is None):
            return spectrum, 0
        inverse = self._below(penalty).reciprocal_()
        wanted = self._data if near is None else self._data + near * penalty
        if self._seen.complete:
            return wanted * inverse, 1
        return solved_on_frequencies(
            lambda x: self._normal(x, penalty), wanted, spectrum, inverse, self._count, steps
        )

    def picture(self, spectrum: torch.Tensor) -> torch.Tensor:
        """On the whole period, with its brightness."""
        return irfft2(spectrum, self._seen.whole).add_(self.mean)

    def residual(self, spectrum: torch.Tensor) -> float:
        """Rms of what is left unexplained of trusted pixels, over the noise."""
        return self._seen.unexplained(self.picture(spectrum * self._seen.transfer)) ** 0.5

    def _below(self, penalty: torch.Tensor) -> torch.Tensor:
        return (self._seen.power + penalty).clamp_(min=1e-12)

    def _normal(self, x: torch.Tensor, penalty: torch.Tensor) -> torch.Tensor:
        light = irfft2(x * self._seen.transfer, self._seen.whole)
        return self._measured(light).add_(x * penalty)

    def _measured(self, light: torch.Tensor) -> torch.Tensor:
        inside, trust = self._seen.frame(light), self._seen.trust
        kept = inside if trust is None else inside * trust
        return rfft2(centred_pad(kept, self._seen.whole)).mul_(self._seen.back)


def solved_on_frequencies(
    normal: Callable[[torch.Tensor], torch.Tensor],
    wanted: torch.Tensor,
    spectrum: torch.Tensor,
    inverse: torch.Tensor,
    count: torch.Tensor,
    steps: int,
) -> tuple[torch.Tensor, int]:
    """The spectrum of the x with normal(x) = wanted, and how many steps it took from the one that
    is given: see conjugate_gradients().

    count: see optics.fourier.half_counts().
    """

    inner = partial(_inner, count=count)
    enough = _SOLVED**2 * inner(wanted, wanted * inverse)
    left = wanted - normal(spectrum)
    return conjugate_gradients(normal, left, spectrum, inverse, inner, enough, steps)


@torch.no_grad()
def _inner(a: torch.Tensor, b: torch.Tensor, count: torch.Tensor) -> float:
    products = (a.real * b.real + a.imag * b.imag) * count
    return float(products.sum(dtype=torch.float64))
