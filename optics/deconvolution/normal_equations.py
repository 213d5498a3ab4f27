"""The linear part of a restoration: (H* M H + K) x = H* M y + K z, on frequencies."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, partial

import torch

from optics.deconvolution.conjugate_gradients import conjugate_gradients
from optics.deconvolution.observation import Observation
from optics.fourier import irfft2, rfft2, rfft_column_weights
from optics.plane import centred_pad

_CG_TOLERANCE = 1e-5
"""Of the right-hand side, in the preconditioner's norm, that may be left."""


class NormalEquations:
    """Of a photograph less a brightness that is set apart, which no K darkens.

    A period that was seen whole is solved at once, anything else by conjugate gradients that the
    solution for the whole period preconditions.
    """

    def __init__(self, observation: Observation) -> None:
        self._observation = observation
        self.mean = observation.inpainted_image.mean()
        self._count = rfft_column_weights(observation.period_shape[1])

    @cached_property
    def _data(self) -> torch.Tensor:
        """H* M y."""
        return self._apply_adjoint(
            centred_pad(
                self._observation.inpainted_image - self.mean, self._observation.period_shape
            )
        )

    def initial_spectrum(self, penalty: torch.Tensor) -> torch.Tensor:
        """The solution if the smooth continuation of the photograph had been measured."""
        spectrum = rfft2(self._observation.extended_image - self.mean).mul_(
            self._observation.conjugate_otf
        )
        return spectrum.mul_(self._denominator(penalty).reciprocal_())

    def solve(
        self,
        penalty: torch.Tensor,
        spectrum: torch.Tensor,
        steps: int,
        target_spectrum: torch.Tensor | None = None,
    ) -> tuple[torch.Tensor, int]:
        """The spectrum of x, and how many steps it took from the one that is given.

        penalty: K, of each frequency. target_spectrum: spectrum of z less the brightness; 0 if
        None.
        """
        if steps == 0 or (self._observation.is_fully_measured and target_spectrum is None):
            return spectrum, 0
        inverse = self._denominator(penalty).reciprocal_()
        wanted = self._data if target_spectrum is None else self._data + target_spectrum * penalty
        if self._observation.is_fully_measured:
            return wanted * inverse, 1
        return solve_on_frequencies(
            lambda x: self._apply_normal(x, penalty), wanted, spectrum, inverse, self._count, steps
        )

    def picture(self, spectrum: torch.Tensor) -> torch.Tensor:
        """On the whole period, with its brightness."""
        return irfft2(spectrum, self._observation.period_shape).add_(self.mean)

    def residual(self, spectrum: torch.Tensor) -> float:
        """Rms of what is left unexplained of trusted pixels, over the noise."""
        return (
            self._observation.mean_squared_residual(self.picture(spectrum * self._observation.otf))
            ** 0.5
        )

    def _denominator(self, penalty: torch.Tensor) -> torch.Tensor:
        return (self._observation.squared_mtf + penalty).clamp_(min=1e-12)

    def _apply_normal(self, x: torch.Tensor, penalty: torch.Tensor) -> torch.Tensor:
        light = irfft2(x * self._observation.otf, self._observation.period_shape)
        return self._apply_adjoint(light).add_(x * penalty)

    def _apply_adjoint(self, light: torch.Tensor) -> torch.Tensor:
        inside, trust = self._observation.crop_to_frame(light), self._observation.effective_weights
        kept = inside if trust is None else inside * trust
        return rfft2(centred_pad(kept, self._observation.period_shape)).mul_(
            self._observation.conjugate_otf
        )


def solve_on_frequencies(
    normal: Callable[[torch.Tensor], torch.Tensor],
    right_hand_side: torch.Tensor,
    spectrum: torch.Tensor,
    preconditioner: torch.Tensor,
    count: torch.Tensor,
    steps: int,
) -> tuple[torch.Tensor, int]:
    """The spectrum of the x with normal(x) = right_hand_side, and how many steps it took.

    From the one that is given: see conjugate_gradients(). count: see
    optics.fourier.rfft_column_weights().
    """

    inner = partial(_inner, count=count)
    enough = _CG_TOLERANCE**2 * inner(right_hand_side, right_hand_side * preconditioner)
    left = right_hand_side - normal(spectrum)
    return conjugate_gradients(normal, left, spectrum, preconditioner, inner, enough, steps)


@torch.no_grad()
def _inner(a: torch.Tensor, b: torch.Tensor, count: torch.Tensor) -> float:
    products = (a.real * b.real + a.imag * b.imag) * count
    return float(products.sum(dtype=torch.float64))
