"""The linear part of a restoration: (H* M H + K) x = H* M y + K z, on frequencies."""

from __future__ import annotations

import torch

from optics.deconvolution.blurred import Blurred
from optics.fourier import irfft2, rfft2
from optics.operators.pixels import Window

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
        self.power = seen.transfer.real.square() + seen.transfer.imag.square()
        self._back = seen.transfer.conj().resolve_conj()
        self._whole = seen.border == "periodic" and seen.trust is None
        self._window = Window(seen.whole, seen.image.shape)
        columns = seen.whole[1]
        # Each frequency of a half stands for its mirror image as well, but for those that are it.
        self._count = torch.full((columns // 2 + 1,), 2.0)
        self._count[0] = 1
        if columns % 2 == 0:
            self._count[-1] = 1
        self._data = self._measured(self._window.adjoint(seen.filled - self.mean))

    def start(self, penalty: torch.Tensor) -> torch.Tensor:
        """The solution if the smooth continuation of the photograph had been measured."""
        spectrum = rfft2(self._seen.continued - self.mean).mul_(self._back)
        return spectrum / self._below(penalty)

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
        if self._whole and near is None:
            return spectrum, 0
        inverse = self._below(penalty).reciprocal_()
        wanted = self._data if near is None else self._data + near * penalty
        if self._whole:
            return wanted * inverse, 1
        enough = _SOLVED**2 * self._inner(wanted, wanted * inverse)
        left = wanted - self._normal(spectrum, penalty)
        turned = left * inverse
        way, length = turned.clone(), self._inner(left, turned)
        taken = 0
        while taken < steps and length > enough:
            bent = self._normal(way, penalty)
            far = length / self._inner(way, bent)
            spectrum = spectrum.add(way, alpha=far)
            left = left.sub_(bent, alpha=far)
            turned = left * inverse
            before, length = length, self._inner(left, turned)
            way = way.mul_(length / before).add_(turned)
            taken += 1
        return spectrum, taken

    def picture(self, spectrum: torch.Tensor) -> torch.Tensor:
        """On the whole period, with its brightness."""
        return irfft2(spectrum, self._seen.whole).add_(self.mean)

    @torch.no_grad()
    def residual(self, spectrum: torch.Tensor) -> float:
        """Rms of what is left unexplained of trusted pixels, over the noise."""
        seen = self._seen
        light = irfft2(spectrum * seen.transfer, seen.whole).add_(self.mean)
        left = (seen.frame(light) - seen.data).square_()
        if seen.trust is None:
            return float(left.mean()) ** 0.5 / seen.deviation
        count = int((seen.trust > 0).sum())
        return float(left.mul_(seen.trust).sum() / count) ** 0.5 / seen.deviation

    def _below(self, penalty: torch.Tensor) -> torch.Tensor:
        return (self.power + penalty).clamp(min=1e-12)

    def _normal(self, x: torch.Tensor, penalty: torch.Tensor) -> torch.Tensor:
        light = irfft2(x * self._seen.transfer, self._seen.whole)
        return self._measured(light).add_(x * penalty)

    def _measured(self, light: torch.Tensor) -> torch.Tensor:
        inside, trust = self._seen.frame(light), self._seen.trust
        kept = inside if trust is None else inside * trust
        return rfft2(self._window.adjoint(kept)).mul_(self._back)

    @torch.no_grad()
    def _inner(self, a: torch.Tensor, b: torch.Tensor) -> float:
        products = (a.real * b.real + a.imag * b.imag) * self._count
        return float(products.sum(dtype=torch.float64))
