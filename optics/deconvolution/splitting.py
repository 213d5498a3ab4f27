"""Restoration by ADMM, which splits priors, data and blur into steps with closed forms."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch

from optics.deconvolution.noise import squared_modulus
from optics.deconvolution.observation import Observation
from optics.deconvolution.priors import LEAST_WEIGHT_SHARE, Penalty, Prior
from optics.deconvolution.restored_image import RestoredImage, has_converged, relative_change
from optics.fourier import irfft2, rfft2, rfft_column_weights
from optics.progress import Progress

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

RELAXATION = 1.8
"""Over-relaxation of the blurred light: 1 is none, below 2 converges (Eckstein and Bertsekas 1992,
doi 10.1007/BF01581204). It saves about a third of the iterations."""

DataProx = Callable[[torch.Tensor, float], torch.Tensor]
"""The proximal step of a data term. For a light in the frame and a coupling, it returns the light
that minimises data term + coupling / 2 * its squared distance to the given light, pixel by pixel.
"""


@dataclass(frozen=True)
class SplittingSettings:
    """The iterations, tolerance and weight of a restoration by splitting.

    Attributes
    ----------
    iterations : int
        Largest number of iterations.
    tol : float
        Relative change of the picture at which the iteration ends; 0 for all iterations.
    weight : float, optional
        Regularisation weight of the penalty. If None, it starts at `initial_weight` and is
        estimated during the iteration.
    initial_weight : float
        The weight of the first iterations if `weight` is None.
    """

    iterations: int
    tol: float = 0.0
    weight: float | None = None
    initial_weight: float = 0.0


def damped_weight(
    target: float,
    weight: float,
    initial: float,
    max_factor: float = 2.5,
    min_factor: float = LEAST_WEIGHT_SHARE,
) -> float:
    """Move the weight of a deconvolution's prior 30 % of the way to its target, in logarithms.

    The target is limited to `min_factor` to `max_factor` times the initial weight. Before the
    iterations have converged, the picture explains too little, and would ask for less weight.
    """
    target = min(max(target, initial * min_factor), initial * max_factor)
    return weight * (target / weight) ** 0.3


class _DataTerm(ABC):
    """Base class of the data term of a restoration by splitting."""

    def __init__(self, observation: Observation) -> None:
        self.observation = observation

    @abstractmethod
    def right_hand_side(self, data_coupling: float) -> torch.Tensor:
        """Return the photograph's part of a deconvolution step's right-hand side, as a spectrum.

        The part includes the coupling. Callers mustn't overwrite it.
        """

    @abstractmethod
    def coupling(self, data_coupling: float) -> float:
        """Return the factor of ``|H|²`` in the denominator of a deconvolution's picture step."""

    @abstractmethod
    def update(self, spectrum: torch.Tensor, data_coupling: float) -> None:
        """Update the split of a deconvolution's data term for the next picture.

        The method may overwrite the spectrum.
        """

    @property
    @abstractmethod
    def mean_squared_residual(self) -> float:
        """The last deconvolved picture's mean squared residual, relative to the noise variance."""


class _FullPeriodData(_DataTerm):
    """The data term of a photograph that is a whole period, which needs no split."""

    def __init__(self, observation: Observation) -> None:
        super().__init__(observation)
        self._data = rfft2(observation.normalised_image)
        self._adjoint_data = self._data * observation.conjugate_otf
        self._last_spectrum = self._data

    def right_hand_side(self, data_coupling: float) -> torch.Tensor:
        return self._adjoint_data

    def coupling(self, data_coupling: float) -> float:
        return 1.0

    def update(self, spectrum: torch.Tensor, data_coupling: float) -> None:
        self._last_spectrum = spectrum

    @property
    def mean_squared_residual(self) -> float:
        left = squared_modulus(self._last_spectrum * self.observation.otf - self._data)
        rows, columns = self.observation.period_shape
        total = float((left * rfft_column_weights(columns)).sum())
        return total / (rows * columns) ** 2 / self.observation.scene_noise**2


class _SplitDataTerm(_DataTerm):
    """The data term with H x split off, for a part of a period or a data term without squares."""

    def __init__(self, observation: Observation, data_prox: DataProx | None) -> None:
        super().__init__(observation)
        self._data_prox = data_prox or self._least_squares
        self._light = observation.extended_image.clone()
        self._split: torch.Tensor | None = None
        self._dual = torch.zeros_like(observation.normalised_image)
        self._mean_squared_residual = 1.0

    def right_hand_side(self, data_coupling: float) -> torch.Tensor:
        return rfft2(self._light).mul_(self.observation.conjugate_otf).mul_(data_coupling)

    def coupling(self, data_coupling: float) -> float:
        return data_coupling

    def update(self, spectrum: torch.Tensor, data_coupling: float) -> None:
        seen = self.observation
        self._light = irfft2(spectrum.mul_(seen.otf), seen.period_shape)
        self._mean_squared_residual = seen.mean_squared_residual(self._light)
        light = seen.crop_to_frame(self._light)
        if self._split is not None:
            light.mul_(RELAXATION).add_(self._split, alpha=1 - RELAXATION)
        light.add_(self._dual)
        wanted = self._data_prox(light, data_coupling)
        if seen.clipped is not None:
            # The light of a clipped pixel is at least the measured value.
            wanted = torch.where(seen.clipped, torch.maximum(light, seen.normalised_image), wanted)
        torch.sub(light, wanted, out=self._dual)
        torch.sub(wanted, self._dual, out=light)
        self._split = wanted

    def _least_squares(self, light: torch.Tensor, data_coupling: float) -> torch.Tensor:
        """Do the proximal step of a deconvolution's weighted least-squares data term."""
        data, trust = self.observation.normalised_image, self.observation.effective_weights
        if trust is None:
            return torch.lerp(light, data, 1 / (1 + data_coupling))
        return (trust * data + data_coupling * light) / (trust + data_coupling)

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


class Splitting:
    """A restoration that minimises |H x - y|² / 2 + weight * penalty(D x) by ADMM.

    The first term counts trusted pixels only, and x is limited to what the other priors allow.
    `data_prox` replaces the squares by another data term of H x.

    The solver is the alternating direction method of multipliers (Boyd et al. 2011, doi
    10.1561/2200000016) with H x and every D x split off (Almeida and Figueiredo 2013, doi
    10.1109/TIP.2013.2258354). Each step has a closed form: the picture's step on frequencies, and
    the data's step on pixels, for any border and any missing pixels.
    """

    def __init__(
        self,
        observation: Observation,
        penalty: Penalty,
        others: Sequence[Prior],
        steps: SplittingSettings,
        data_prox: DataProx | None = None,
    ) -> None:
        self._observation, self._penalty, self._steps = observation, penalty, steps
        plain = observation.is_fully_measured and data_prox is None
        self._data: _DataTerm = (
            _FullPeriodData(observation) if plain else _SplitDataTerm(observation, data_prox)
        )
        self._priors: list[Prior] = [penalty, *others]
        self._weight = steps.initial_weight if steps.weight is None else steps.weight
        self._coupling = _relative_coupling(observation, steps.iterations, self._weight)
        self._inverse: torch.Tensor | None = None
        self._inverse_for = 0.0

    def solve(self, method: str, progress: Progress) -> RestoredImage:
        """Run the iterations of a deconvolution by splitting, and return the restored picture.

        `method` is the name for progress reports and for the result.
        """
        steps, change = self._steps, list[float]()
        picture, ended = self._observation.extended_image, False
        for number in range(steps.iterations):
            progress.report(number / steps.iterations, f"{method} {number + 1}/{steps.iterations}")
            before, picture = picture, self._picture()
            for prior in self._priors:
                prior.update(picture)
            # The weight is estimated from the sixth iteration on.
            if steps.weight is None and number >= 5:
                self._reweigh()
            change.append(relative_change(picture, before))
            if steps.tol and change[-1] <= steps.tol:
                ended = True
                break
        return RestoredImage(
            self._observation.crop_to_frame(picture).clamp(min=0),
            method,
            self._observation.noise,
            self._data.mean_squared_residual**0.5,
            self._weight,
            len(change),
            change,
            ended if steps.tol else has_converged(change),
            picture,
        )

    def _picture(self) -> torch.Tensor:
        """Compute the deconvolution's next picture from the photograph and the priors' splits."""
        held = self._coupling * (self._weight / self._observation.scale) ** 0.5
        own = self._data.coupling(held)
        spectrum = self._right_hand_side(held, own).mul_(self._inverse_denominator(own))
        picture = irfft2(spectrum, self._observation.period_shape)
        self._data.update(spectrum, held)
        return picture

    def _right_hand_side(self, data_coupling: float, data_factor: float) -> torch.Tensor:
        """Add up the parts of photograph and priors in a deconvolution step's right-hand side.

        Callers may overwrite the spectrum.
        """
        first, *others = self._priors
        wanted, pull = first.adjoint_target, self._data.right_hand_side(data_coupling)
        if wanted is None:
            return pull.clone()
        coupled = first.coupling(self._weight, data_factor)
        for prior in others:
            if prior.adjoint_target is not None:
                share = prior.coupling(self._weight, data_factor) / coupled
                wanted = torch.add(wanted, prior.adjoint_target, alpha=share)
        spectrum = rfft2(wanted)
        return torch.add(pull, spectrum, alpha=coupled, out=spectrum)

    def _inverse_denominator(self, data_factor: float) -> torch.Tensor:
        """Return the inverse denominator of a deconvolution's picture step.

        The result is kept in memory until the weight changes.
        """
        if self._inverse is None or self._inverse_for != self._weight:
            below = self._observation.squared_mtf * data_factor
            # This keeps frequencies at 0 that neither the blur nor a prior determines.
            below.add_(1e-9 * data_factor)
            for prior in self._priors:
                below.add_(prior.gram_spectrum, alpha=prior.coupling(self._weight, data_factor))
            self._inverse, self._inverse_for = below.reciprocal_(), self._weight
        return self._inverse

    def _reweigh(self) -> None:
        """Move the weight of a deconvolution's prior towards its estimate from the last picture."""
        seen = self._observation
        freedom = seen.explained_share(self._data.mean_squared_residual)
        wanted = self._penalty.estimate_weight(seen.disturbance, freedom)
        self._weight = damped_weight(wanted, self._weight, self._steps.initial_weight)
