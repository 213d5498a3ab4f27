"""The normal equations of a restoration with a quadratic penalty, solved on frequencies.

They are (H* M H + K) x = H* M y + K z, with the blur H, the pixels' weights M, the photograph y,
the penalty K of each frequency, and the picture z to which the penalty pulls x.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property, partial
from typing import Any

import torch

from optics.deconvolution.conjugate_gradients import conjugate_gradients
from optics.deconvolution.observation import Observation
from optics.fourier import irfft2, rfft2, rfft_column_weights
from optics.plane import centred_pad

_LEAST_PENALTY = 2e-4
"""Least K at the PSF's own frequency, times the squared number of steps over the squared radius of
the PSF in pixels. The number of conjugate-gradient steps grows as the square root of the condition
number. Measured with 11 PSFs and three noises: of 0.05 to 1 times the squared radius, the weights
of about 0.05 for a disk of 7 pixels, 0.2 for a ring of 12 and 1 for one of 30 are the best."""

_PERIODS_PER_RADIUS = 2.7
"""Period of the PSF's own frequency over its root mean square radius."""


def least_weight(
    observation: Observation, shape: Callable[[torch.Tensor], torch.Tensor], steps: int
) -> float:
    """Return the least weight of a deconvolution's penalty K that so many steps can solve.

    `shape` is K for a weight of 1, by the squared frequency in (cycles/pixel)². With a smaller
    weight, the light from beyond the frame isn't found yet after these steps, and its errors are
    amplified; they are worst at frequencies of about the PSF's size.
    """
    if observation.is_fully_measured:
        return 0.0
    frequency = 1 / (_PERIODS_PER_RADIUS * max(observation.psf_radius, 0.1))
    there = float(shape(torch.tensor([frequency**2], dtype=torch.float64)))
    # The smooth continuation of the photograph is worth two steps.
    least = _LEAST_PENALTY * (observation.psf_radius / max(steps, 2)) ** 2
    return least / max(there, 1e-30)


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

    def extended_spectrum(self) -> torch.Tensor:
        """Return the spectrum of the photograph's smooth extension, less its mean.

        It is the best start of conjugate gradients where the PSF is wide.
        """
        return rfft2(self._observation.extended_image - self.mean)

    def initial_spectrum(self, penalty: torch.Tensor) -> torch.Tensor:
        """Solve the deconvolution as if the photograph's smooth extension had been measured."""
        spectrum = self.extended_spectrum() * self._observation.conjugate_otf
        return spectrum * self._denominator(penalty).reciprocal()

    def solve(
        self,
        penalty: torch.Tensor,
        spectrum: torch.Tensor,
        steps: int,
        target_spectrum: torch.Tensor | None = None,
    ) -> tuple[torch.Tensor, int, float]:
        """Solve the normal equations of the deconvolution: see solve_on_frequencies().

        The solver starts from `spectrum`. `penalty` is K of each frequency. `target_spectrum` is
        the spectrum of z less the mean, or 0 if None.
        """
        if steps == 0 or (self._observation.is_fully_measured and target_spectrum is None):
            return spectrum, 0, 0.0
        inverse = self._denominator(penalty).reciprocal_()
        wanted = self._data if target_spectrum is None else self._data + target_spectrum * penalty
        if self._observation.is_fully_measured:
            return wanted * inverse, 1, 0.0
        return solve_on_frequencies(
            lambda x: self._apply_normal(x, penalty), wanted, spectrum, inverse, self._count, steps
        )

    def picture_with_gradients(
        self, penalty: torch.Tensor, spectrum: torch.Tensor, steps: int
    ) -> torch.Tensor:
        """Return the solution's picture with its derivatives, on the whole period.

        `spectrum` is the solution of the deconvolution. The derivatives are those of the normal
        equations' exact solution, by the photograph and the PSF. They take the memory of one
        application of the equations, whatever the number of steps was.
        """
        found = spectrum.detach()
        left = self._data - self._apply_normal(found, penalty)
        shape = self._observation.period_shape

        def solve(picture: torch.Tensor) -> torch.Tensor:
            inverse = self._denominator(penalty.detach()).reciprocal_().detach()
            wanted = rfft2(picture)
            answer, *_ = solve_on_frequencies(
                lambda x: self._apply_normal(x, penalty),
                wanted, torch.zeros_like(wanted), inverse, self._count, steps,
            )  # fmt: skip
            return irfft2(answer, shape)

        step = _SymmetricSolution.apply(irfft2(left, shape), solve)  # type: ignore[no-untyped-call]
        picture: torch.Tensor = self.picture(found) + step
        return picture

    def picture(self, spectrum: torch.Tensor) -> torch.Tensor:
        """Convert a spectrum to the deconvolved picture on the whole period, with its mean."""
        # Adding in place is differentiable, since no derivative needs the sum.
        return irfft2(spectrum, self._observation.period_shape).add_(self.mean)

    def residual(self, spectrum: torch.Tensor) -> float:
        """Return the deconvolution's rms residual of trusted pixels, relative to the noise."""
        return (
            self._observation.mean_squared_residual(self.picture(spectrum * self._observation.otf))
            ** 0.5
        )

    def _denominator(self, penalty: torch.Tensor) -> torch.Tensor:
        """Return the deconvolution's denominator ``|H|² + K``, kept above 0 for its inversion."""
        return (self._observation.squared_mtf + penalty).clamp(min=1e-12)

    def _apply_normal(self, x: torch.Tensor, penalty: torch.Tensor) -> torch.Tensor:
        """Apply the deconvolution's normal matrix H* M H + K to a spectrum."""
        light = irfft2(x * self._observation.otf, self._observation.period_shape)
        return self._apply_adjoint(light).add_(x * penalty)

    def _apply_adjoint(self, light: torch.Tensor) -> torch.Tensor:
        """Apply a deconvolution's adjoint blur H* M to light on the period; return the spectrum."""
        inside, trust = self._observation.crop_to_frame(light), self._observation.effective_weights
        kept = inside if trust is None else inside * trust
        spectrum = rfft2(centred_pad(kept, self._observation.period_shape))
        return spectrum * self._observation.conjugate_otf


class _SymmetricSolution(torch.autograd.Function):
    """The solution of a deconvolution's symmetric linear equations, by their right-hand side.

    The matrix is symmetric, so that the derivative's adjoint is the same solution.
    """

    @staticmethod
    def forward(
        ctx: Any, picture: torch.Tensor, solve: Callable[[torch.Tensor], torch.Tensor]
    ) -> torch.Tensor:
        """Solve the deconvolution's equations for one right-hand side, a picture."""
        ctx.solve = solve
        return solve(picture)

    @staticmethod
    def backward(ctx: Any, *gradients: torch.Tensor) -> tuple[torch.Tensor, None]:
        """Solve the deconvolution's equations for the gradient by the solution."""
        with torch.no_grad():
            return ctx.solve(gradients[0]), None


def solve_on_frequencies(
    normal: Callable[[torch.Tensor], torch.Tensor],
    right_hand_side: torch.Tensor,
    spectrum: torch.Tensor,
    preconditioner: torch.Tensor,
    count: torch.Tensor,
    steps: int,
) -> tuple[torch.Tensor, int, float]:
    """Solve a deconvolution's normal equations on rfft2 spectra by conjugate gradients.

    The solver starts from `spectrum` and returns the solution's spectrum, the number of steps, and
    the residual relative to the right-hand side, in the preconditioner's norm: see
    conjugate_gradients(). `count` comes from optics.fourier.rfft_column_weights().
    """

    inner = partial(_inner_product, count=count)
    # The residual may be 1e-5 of the right-hand side, in the preconditioner's norm.
    whole = inner(right_hand_side, right_hand_side * preconditioner)
    left = right_hand_side - normal(spectrum)
    found, taken, rest = conjugate_gradients(
        normal, left, spectrum, preconditioner, inner, 1e-5**2 * whole, steps
    )
    return found, taken, math.sqrt(rest / whole) if whole > 0 else 0.0


@torch.no_grad()
def _inner_product(a: torch.Tensor, b: torch.Tensor, count: torch.Tensor) -> float:
    """Compute the inner product of two real deconvolved pictures from their rfft2 spectra.

    The result is right up to a constant factor.
    """
    products = (a.real * b.real + a.imag * b.imag) * count
    return float(products.sum(dtype=torch.float64))
