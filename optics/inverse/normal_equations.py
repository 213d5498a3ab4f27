"""Normal equations of a blurred photograph, solved by preconditioned conjugate gradients.

Where the whole period was measured, the solution has a closed form. The solver takes any inner
product of the unknowns.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import torch

from optics.fourier import irfft2, rfft2, rfft_column_weights
from optics.fourier.differentiation import differentiate_once
from optics.inverse.observation import Observation
from optics.inverse.priors import Prior
from optics.inverse.splitting import PictureStep
from optics.plane import centred_pad

InnerProduct = Callable[[torch.Tensor, torch.Tensor], float]


def conjugate_gradients(
    normal: Callable[[torch.Tensor], torch.Tensor],
    residual: torch.Tensor,
    start: torch.Tensor,
    preconditioner: torch.Tensor,
    inner_product: InnerProduct,
    tolerance: float,
    steps: int,
) -> tuple[torch.Tensor, int, float]:
    """Solve normal(x) = b by preconditioned conjugate gradients.

    Returns x, the number of steps done, and the inner product that is left (Hestenes and Stiefel
    1952, doi 10.6028/jres.049.044).

    normal: applies the symmetric positive definite matrix to an x.
    residual: b less normal(start); it is overwritten.
    preconditioner: approximate inverse of `normal`, one factor for each unknown.
    tolerance: the inner product of residual and preconditioned residual at which the solver ends.
    steps: largest number of steps.
    """
    turned = residual * preconditioner
    way, length = turned.clone(), inner_product(residual, turned)
    x, taken = start, 0
    while taken < steps and length > tolerance:
        bent = normal(way)
        far = length / inner_product(way, bent)
        x = x.add(way, alpha=far)
        residual = residual.sub_(bent, alpha=far)
        turned = residual * preconditioner
        before, length = length, inner_product(residual, turned)
        way = way.mul_(length / before).add_(turned)
        taken += 1
    return x, taken, length


# Least K at the PSF's own frequency, times the squared number of steps over the squared radius of
# the PSF in pixels. The number of conjugate-gradient steps grows as the square root of the
# condition number. Measured with 11 PSFs and three noises: of 0.05 to 1 times the squared radius,
# the weights of about 0.05 for a disk of 7 pixels, 0.2 for a ring of 12 and 1 for one of 30 are
# the best.
_LEAST_PENALTY = 2e-4

_PERIODS_PER_RADIUS = 2.7  # period of the PSF's own frequency over its root mean square radius


def least_weight(
    observation: Observation, shape: Callable[[torch.Tensor], torch.Tensor], steps: int
) -> float:
    """Return the least weight of a penalty K that so many steps can solve.

    With a smaller one, the light from beyond the frame isn't found yet, and its errors are
    amplified, most at frequencies of about the PSF's size.

    shape: K for a weight of 1, by the squared frequency in (cycles/pixel)².
    """
    if observation.is_fully_measured:
        return 0.0
    frequency = 1 / (_PERIODS_PER_RADIUS * max(observation.psf_radius, 0.1))
    there = float(shape(torch.tensor([frequency**2], dtype=torch.float64)))
    # The smooth continuation of the photograph is worth two steps.
    least = _LEAST_PENALTY * (observation.psf_radius / max(steps, 2)) ** 2
    return least / max(there, 1e-30)


def squared_response(seen: Observation) -> torch.Tensor:
    """Return the squared response of blur and filters to each frequency, a mean over the pixels."""
    filters = seen.relative_filters
    if filters is None:
        return seen.squared_mtf
    return seen.squared_mtf * filters.square().mean((-2, -1), keepdim=True)


class LinearEquations(ABC):
    """Base class of normal equations (B* M B + K) x = B* M y + K z.

    B is any blur, and x holds the spectra of one or more pictures on the observation's period.
    Conjugate gradients solve the equations, preconditioned as if the whole period were measured.
    """

    def __init__(self, observation: Observation) -> None:
        self.observation = observation
        self._count = rfft_column_weights(observation.period_shape[1])

    @property
    @abstractmethod
    def data_spectrum(self) -> torch.Tensor:
        """The spectrum of B* M y, the photograph's part of the right-hand side."""

    @property
    def is_diagonal(self) -> bool:
        """Whether the equations treat each frequency on its own."""
        return False

    @cached_property
    def squared_response(self) -> torch.Tensor:
        """The diagonal of B* M B on frequencies, as the preconditioner takes it."""
        return squared_response(self.observation)

    @abstractmethod
    def apply_data_gram(self, x: torch.Tensor) -> torch.Tensor:
        """Apply B* M B to pictures' spectra."""

    @abstractmethod
    def mean_squared_residual(self, spectrum: torch.Tensor) -> float:
        """Return the mean squared residual, relative to the noise variance."""

    def solve(
        self, wanted: torch.Tensor, penalty: torch.Tensor, start: torch.Tensor, steps: int
    ) -> tuple[torch.Tensor, int, float]:
        """Solve the equations from the spectra `start`, for the right-hand side `wanted`.

        Returns the solution's spectrum, the number of steps, and the residual relative to the
        right-hand side, in the preconditioner's norm: see conjugate_gradients().

        penalty: K of each frequency.
        """
        inverse = self._denominator(penalty).reciprocal_().detach()
        if self.is_diagonal:
            return wanted * inverse, 0, 0.0

        def normal(x: torch.Tensor) -> torch.Tensor:
            return self.apply_data_gram(x).add_(x * penalty)

        @torch.no_grad()
        def inner(a: torch.Tensor, b: torch.Tensor) -> float:
            """Return the inner product of two real pictures, up to a constant factor."""
            products = (a.real * b.real + a.imag * b.imag) * self._count
            return float(products.sum(dtype=torch.float64))

        # The residual may be 1e-5 of the right-hand side.
        whole = inner(wanted, wanted * inverse)
        left = wanted - normal(start)
        found, taken, rest = conjugate_gradients(
            normal, left, start, inverse, inner, 1e-5**2 * whole, steps
        )
        return found, taken, math.sqrt(rest / whole) if whole > 0 else 0.0

    def _denominator(self, penalty: torch.Tensor) -> torch.Tensor:
        """Return ``|H|² + K``, kept above 0 for its inversion."""
        return (self.squared_response + penalty).clamp(min=1e-12)


class NormalEquations(LinearEquations):
    """The equations of one photograph, less its mean, so that the penalty K doesn't darken it.

    With `keeps_mean` it isn't subtracted.
    """

    def __init__(self, observation: Observation, *, keeps_mean: bool = False) -> None:
        super().__init__(observation)
        mean = observation.inpainted_image.mean()
        self.mean = torch.zeros_like(mean) if keeps_mean else mean

    @property
    def is_diagonal(self) -> bool:
        return self.observation.is_fully_measured

    @cached_property
    def data_spectrum(self) -> torch.Tensor:
        return self._apply_adjoint(self.observation.inpainted_image - self.mean)

    def extended_spectrum(self) -> torch.Tensor:
        """Return the spectrum of the photograph's smooth extension, less its mean."""
        return rfft2(self.observation.extended_image - self.mean)

    def initial_spectrum(self, penalty: torch.Tensor) -> torch.Tensor:
        """Solve the equations as if the photograph's smooth extension had been measured."""
        spectrum = self.extended_spectrum() * self.observation.conjugate_otf
        return spectrum * self._denominator(penalty).reciprocal()

    def picture_with_gradients(
        self,
        spectrum: torch.Tensor,
        slope: Callable[[torch.Tensor], torch.Tensor],
        solve: Callable[[torch.Tensor], torch.Tensor],
    ) -> torch.Tensor:
        """Return the solution's picture on the whole period, with its derivatives.

        They are those of the exact solution (implicit function theorem), by all that photograph,
        PSF and slope depend on, and take the memory of one application of the equations.

        spectrum: the solution, where the pull of the data, H* M (y - H x), and the prior's slope
            cancel.
        slope: returns the spectrum of the prior's slope for that of the pull.
        solve: returns the picture's change for a change of the difference.
        """
        found = spectrum.detach()
        pull = self.data_spectrum - self.apply_data_gram(found)
        left = irfft2(pull - slope(pull), self.observation.period_shape)
        step = _SymmetricSolution.apply(left, solve)  # type: ignore[no-untyped-call]
        picture: torch.Tensor = self.picture(found) + step
        return picture

    def picture(self, spectrum: torch.Tensor) -> torch.Tensor:
        """Convert a spectrum to the picture on the whole period, with its mean."""
        # Adding in place is differentiable, since no derivative needs the sum.
        return irfft2(spectrum, self.observation.period_shape).add_(self.mean)

    def mean_squared_residual(self, spectrum: torch.Tensor) -> float:
        light = self.picture(spectrum * self.observation.otf)
        return self.observation.mean_squared_residual(light)

    def apply_data_gram(self, x: torch.Tensor) -> torch.Tensor:
        """Apply H* M H to a spectrum."""
        seen = self.observation
        light = seen.crop_to_frame(irfft2(x * seen.otf, seen.period_shape))
        return self._apply_adjoint(seen.sum_bands(light))

    def _apply_adjoint(self, frame: torch.Tensor) -> torch.Tensor:
        """Return the spectrum of H* M applied to what was measured."""
        seen, trust = self.observation, self.observation.effective_weights
        kept = seen.spread_to_bands(frame if trust is None else frame * trust)
        return rfft2(centred_pad(kept, seen.period_shape)) * seen.conjugate_otf


class _SymmetricSolution(torch.autograd.Function):
    """The solution of symmetric linear equations, differentiable by their right-hand side."""

    @staticmethod
    def forward(
        ctx: Any, picture: torch.Tensor, solve: Callable[[torch.Tensor], torch.Tensor]
    ) -> torch.Tensor:
        ctx.solve = solve
        ctx.save_for_backward(picture)
        return solve(picture)

    @staticmethod
    def backward(ctx: Any, *gradients: torch.Tensor) -> tuple[torch.Tensor, None]:
        """Solve the equations for the gradient by the solution, since their matrix is symmetric."""
        with torch.no_grad():
            found = ctx.solve(gradients[0])
        # The equations themselves depend on the PSF, which a second derivative would have to know.
        return differentiate_once(
            "a restored picture", found, (*ctx.saved_tensors, *gradients)
        ), None


class ConjugateGradientStep(PictureStep):
    """The picture's step of an iteration by splitting, by `steps` of conjugate gradients.

    They start from the last picture, the first time from `start`, which is the photograph if None.
    """

    def __init__(
        self, equations: LinearEquations, steps: int, start: torch.Tensor | None = None
    ) -> None:
        self._equations, self._steps = equations, steps
        super().__init__(equations.observation)
        self._spectrum = rfft2(self.start() if start is None else start)

    def next_picture(self, priors: Sequence[Prior], weight: float) -> torch.Tensor:
        penalty, target = torch.zeros(()).to(self.observation.image), None
        for prior in priors:
            coupling = prior.coupling(weight, 1.0)
            penalty = penalty + prior.gram_spectrum * coupling
            if prior.adjoint_target is not None:
                pulled = prior.adjoint_target * coupling
                target = pulled if target is None else target.add_(pulled)
        wanted = self._equations.data_spectrum
        wanted = wanted if target is None else wanted + rfft2(target)
        self._spectrum, *_ = self._equations.solve(wanted, penalty, self._spectrum, self._steps)
        return irfft2(self._spectrum, self.observation.period_shape)

    def blend_with(self, picture: torch.Tensor, share: float) -> torch.Tensor:
        """Blend the last picture with another one, of which `share` is taken."""
        self._spectrum = self._spectrum.lerp(rfft2(picture), share)
        return irfft2(self._spectrum, self.observation.period_shape)

    @property
    def mean_squared_residual(self) -> float:
        return self._equations.mean_squared_residual(self._spectrum)

    def residual_of(self, picture: torch.Tensor) -> float:
        return self._equations.mean_squared_residual(rfft2(picture))
