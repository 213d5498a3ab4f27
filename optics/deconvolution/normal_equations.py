"""The normal equations of a restoration with a quadratic penalty, solved on frequencies.

They are (H* M H + K) x = H* M y + K z, with the blur H, the pixels' weights M, the photograph y,
the penalty K of each frequency, and the picture z to which the penalty pulls x.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, partial

import torch

from optics.deconvolution.conjugate_gradients import conjugate_gradients
from optics.deconvolution.observation import Observation
from optics.fourier import irfft2, rfft2, rfft_column_weights
from optics.plane import centred_pad


class NormalEquations:
    """The normal equations of a photograph's restoration, for the photograph less its mean.

    The mean is added to the solution, so that the penalty K doesn't darken it. If the whole period
    was measured, the solution has a closed form. Otherwise it is found by conjugate gradients,
    preconditioned by that closed form.
    """

    def __init__(self, observation: Observation) -> None:
        self._observation = observation
        self.mean = observation.inpainted_image.mean()
        self._count = rfft_column_weights(observation.period_shape[1])

    @cached_property
    def _data(self) -> torch.Tensor:
        """The spectrum of H* M y, the photograph's part of a deconvolution's right-hand side."""
        return self._apply_adjoint(
            centred_pad(
                self._observation.inpainted_image - self.mean, self._observation.period_shape
            )
        )

    def initial_spectrum(self, penalty: torch.Tensor) -> torch.Tensor:
        """Solve the deconvolution as if the photograph's smooth extension had been measured."""
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
        """Solve the normal equations of the deconvolution; return x's spectrum and step count.

        The solver starts from `spectrum`. `penalty` is K of each frequency. `target_spectrum` is
        the spectrum of z less the mean, or 0 if None.
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
        """Convert a spectrum to the deconvolved picture on the whole period, with its mean."""
        return irfft2(spectrum, self._observation.period_shape).add_(self.mean)

    def residual(self, spectrum: torch.Tensor) -> float:
        """Return the deconvolution's rms residual of trusted pixels, relative to the noise."""
        return (
            self._observation.mean_squared_residual(self.picture(spectrum * self._observation.otf))
            ** 0.5
        )

    def _denominator(self, penalty: torch.Tensor) -> torch.Tensor:
        """Return the deconvolution's denominator ``|H|² + K``, kept above 0 for its inversion."""
        return (self._observation.squared_mtf + penalty).clamp_(min=1e-12)

    def _apply_normal(self, x: torch.Tensor, penalty: torch.Tensor) -> torch.Tensor:
        """Apply the deconvolution's normal matrix H* M H + K to a spectrum."""
        light = irfft2(x * self._observation.otf, self._observation.period_shape)
        return self._apply_adjoint(light).add_(x * penalty)

    def _apply_adjoint(self, light: torch.Tensor) -> torch.Tensor:
        """Apply a deconvolution's adjoint blur H* M to light on the period; return the spectrum."""
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
    """Solve a deconvolution's normal equations on rfft2 spectra by conjugate gradients.

    The solver starts from `spectrum` and returns the solution's spectrum and the number of steps:
    see conjugate_gradients(). `count` comes from optics.fourier.rfft_column_weights().
    """

    inner = partial(_inner_product, count=count)
    # The residual may be 1e-5 of the right-hand side, in the preconditioner's norm.
    enough = 1e-5**2 * inner(right_hand_side, right_hand_side * preconditioner)
    left = right_hand_side - normal(spectrum)
    return conjugate_gradients(normal, left, spectrum, preconditioner, inner, enough, steps)


@torch.no_grad()
def _inner_product(a: torch.Tensor, b: torch.Tensor, count: torch.Tensor) -> float:
    """Compute the inner product of two real deconvolved pictures from their rfft2 spectra.

    The result is right up to a constant factor.
    """
    products = (a.real * b.real + a.imag * b.imag) * count
    return float(products.sum(dtype=torch.float64))
