"""The picture's step of a restoration by splitting that has a closed form on frequencies.

If the whole period was measured, the data term is diagonal in frequency. Otherwise the blurred
light is split off (Almeida and Figueiredo 2013, doi 10.1109/TIP.2013.2258354), so that its step
treats each pixel on its own, for any border, any missing pixels and any filters.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence

import torch

from optics.deconvolution.observation import Observation
from optics.deconvolution.priors import RELAXATION, Prior
from optics.deconvolution.splitting import PictureStep
from optics.fourier import irfft2, rfft2, rfft_column_weights
from optics.operators.gram import GramOperator, squared_modulus

LEAST_COUPLING, MOST_COUPLING, COUPLED_ITERATIONS = 0.5, 3.0, 20.0
"""Coupling of the blurred light's split, over the square root of weight over scale: the last number
over that of iterations, within the first two. A strong coupling gets farthest in few iterations; a
weak one is needed for what lies beyond the frame. Measured: of 0.25 to 8, these are the best for 8,
12, 20 and 30 iterations."""

WIDE_COUPLING, NOISY_ITERATIONS = 100.0, 500.0
"""Largest coupling, times the squared radius of the PSF in pixels, where the scene goes on beyond
the frame; and the number of iterations, over the square root of weight over scale, below which it
is larger in proportion. Measured with seven PSFs, 6 to 60 iterations and two noises: of 0.1 to 3,
the best for a ring of 30 pixels is 0.1 to 0.2, for one of 12 it is 0.4 to 3."""

DataProx = Callable[[torch.Tensor, float], torch.Tensor]
"""The proximal step of a data term. For a light in the frame and a coupling, it returns the light
that minimises data term + coupling / 2 * its squared distance to the given light, pixel by pixel.
"""


def frequency_step(
    observation: Observation, iterations: int, data_prox: DataProx | None = None
) -> PictureStep:
    """Return the closed-form picture's step of a restoration by splitting.

    `data_prox` replaces the weighted squares by another data term of the light in the frame.
    `iterations` is the number that is planned.
    """
    if observation.is_fully_measured and data_prox is None:
        return _FullPeriodStep(observation)
    return _SplitLightStep(observation, iterations, data_prox)


class _FrequencyStep(PictureStep):
    """Base class of the steps of a restoration's picture that are diagonal in frequency."""

    def __init__(self, observation: Observation) -> None:
        super().__init__(observation)
        self._inverse: GramOperator | None = None
        self._inverse_for = 0.0

    @abstractmethod
    def _couplings(self, weight: float) -> tuple[float, float]:
        """Return the deconvolution's coupling of the blurred light, and the factor of |H|²."""

    @abstractmethod
    def _pull(self, held: float) -> torch.Tensor:
        """Return the photograph's part of a deconvolution step's right-hand side, as a spectrum.

        `held` is the coupling. Callers mustn't overwrite the result.
        """

    @abstractmethod
    def _finish(self, spectrum: torch.Tensor, held: float) -> None:
        """Update the split of a deconvolution's data term; it may overwrite the spectrum."""

    def next_picture(self, priors: Sequence[Prior], weight: float) -> torch.Tensor:
        held, factor = self._couplings(weight)
        spectrum = self._right_hand_side(priors, weight, held, factor)
        spectrum.mul_(self._inverse_gram(priors, weight, factor).weights)
        picture = irfft2(spectrum, self.observation.period_shape)
        self._finish(spectrum, held)
        return picture

    def _right_hand_side(
        self, priors: Sequence[Prior], weight: float, held: float, factor: float
    ) -> torch.Tensor:
        """Add up the parts of photograph and priors in a deconvolution step's right-hand side.

        Callers may overwrite the spectrum.
        """
        first, *others = priors
        wanted, pull = first.adjoint_target, self._pull(held)
        if wanted is None:
            return pull.clone()
        coupled = first.coupling(weight, factor)
        for prior in others:
            if prior.adjoint_target is not None:
                share = prior.coupling(weight, factor) / coupled
                wanted = torch.add(wanted, prior.adjoint_target, alpha=share)
        spectrum = rfft2(wanted)
        return torch.add(pull, spectrum, alpha=coupled, out=spectrum)

    def _inverse_gram(self, priors: Sequence[Prior], weight: float, factor: float) -> GramOperator:
        """Return the inverse of a deconvolution's normal equations, kept until the weight changes.

        It has one factor for each band and frequency, in which the priors' parts are penalties.
        """
        if self._inverse is None or self._inverse_for != weight:
            seen = self.observation
            # This keeps frequencies at 0 that neither the blur nor a prior determines.
            penalty = torch.full((), 1e-9 * factor).to(seen.squared_mtf)
            for prior in priors:
                penalty = penalty.add(prior.gram_spectrum, alpha=prior.coupling(weight, factor))
            data = GramOperator("frequencies", seen.squared_mtf * factor, seen.period_shape)
            self._inverse, self._inverse_for = data.inverse(penalty), weight
        return self._inverse


class _FullPeriodStep(_FrequencyStep):
    """The picture's step for a photograph that is a whole period, which needs no split."""

    def __init__(self, observation: Observation) -> None:
        super().__init__(observation)
        self._data = rfft2(observation.normalised_image)[None]
        self._adjoint_data = self._data * observation.conjugate_otf
        self._last_spectrum = self._data

    def _couplings(self, weight: float) -> tuple[float, float]:
        return 1.0, 1.0

    def _pull(self, held: float) -> torch.Tensor:
        return self._adjoint_data

    def _finish(self, spectrum: torch.Tensor, held: float) -> None:
        self._last_spectrum = spectrum

    @property
    def mean_squared_residual(self) -> float:
        left = squared_modulus(self._last_spectrum * self.observation.otf - self._data)
        rows, columns = self.observation.period_shape
        total = float((left * rfft_column_weights(columns)).sum())
        return total / (rows * columns) ** 2 / self.observation.scene_noise**2


class _SplitLightStep(_FrequencyStep):
    """The picture's step with the blurred light split off."""

    def __init__(
        self, observation: Observation, iterations: int, data_prox: DataProx | None
    ) -> None:
        super().__init__(observation)
        self._iterations, self._data_prox = iterations, data_prox
        self._coupling: float | None = None
        self._light = self.start().clone()
        self._split: torch.Tensor | None = None
        self._dual = torch.zeros_like(observation.crop_to_frame(self._light))
        self._mean_squared_residual = 1.0

    def _couplings(self, weight: float) -> tuple[float, float]:
        if self._coupling is None:
            self._coupling = _relative_coupling(self.observation, self._iterations, weight)
        held = self._coupling * (weight / self.observation.scale) ** 0.5
        return held, held

    def _pull(self, held: float) -> torch.Tensor:
        return rfft2(self._light).mul_(self.observation.conjugate_otf).mul_(held)

    def _finish(self, spectrum: torch.Tensor, held: float) -> None:
        seen = self.observation
        self._light = irfft2(spectrum.mul_(seen.otf), seen.period_shape)
        self._mean_squared_residual = seen.mean_squared_residual(self._light)
        light = seen.crop_to_frame(self._light)
        if self._split is not None:
            light.mul_(RELAXATION).add_(self._split, alpha=1 - RELAXATION)
        light.add_(self._dual)
        taken = self._step_to_data(light, held)
        # The new split is light + taken, and the new dual variable is -taken.
        self._split = light + taken
        light.add_(taken, alpha=2)
        self._dual = taken.neg_()

    def _step_to_data(self, light: torch.Tensor, held: float) -> torch.Tensor:
        """Return what the proximal step of a deconvolution's data term adds to light."""
        seen = self.observation
        left = seen.normalised_image - seen.sum_bands(light)
        if self._data_prox is not None:
            step = self._data_prox(light, held) - light
        else:
            step = left.mul(self._gain(held))
        if seen.clipped is not None:
            # The light of a clipped pixel is at least the measured value.
            missing = left.clamp(min=0) / seen.filter_power
            step = torch.where(seen.clipped, missing, step)
        return seen.spread_to_bands(step)

    def _gain(self, held: float) -> float | torch.Tensor:
        """Return the share of the misfit that the proximal step of weighted squares takes back."""
        seen, trust = self.observation, self.observation.effective_weights
        if trust is None:
            return 1 / (held + seen.filter_power)
        return trust / (held + trust * seen.filter_power)

    @property
    def mean_squared_residual(self) -> float:
        return self._mean_squared_residual


def _relative_coupling(observation: Observation, iterations: int, weight: float) -> float:
    """Return the coupling of a deconvolution's blurred light, relative to the weight's root."""
    coupling = min(max(COUPLED_ITERATIONS / iterations, LEAST_COUPLING), MOST_COUPLING)
    if observation.border == "periodic":
        return coupling
    noisy = NOISY_ITERATIONS * (weight / observation.scale) ** 0.5 / iterations
    return min(coupling, max(noisy, 1.0) * WIDE_COUPLING / max(observation.psf_radius, 1.0) ** 2)
