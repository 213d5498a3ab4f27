"""Restoration by splitting: priors, data and blur each in the domain where it is easy."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch

from optics.deconvolution.noise import squared_modulus
from optics.deconvolution.observation import Observation
from optics.deconvolution.priors import Penalty, Prior
from optics.deconvolution.restored_image import RestoredImage, relative_change
from optics.fourier import irfft2, rfft2, rfft_column_weights
from optics.progress import Progress

_TINY = 1e-9
"""Of the data's own denominator: where no light gets through and no prior looks, nothing is asked
for."""

_DATA_COUPLING = 2.0
"""Coupling of the data's split, over the root of the prior's weight on the picture's scale: the
fastest of 0.5 to 4 for kernels and noise of all kinds."""

_WEIGHT_DELAY, _WEIGHT_DAMPING, _MAX_WEIGHT_FACTOR = 5, 0.3, 2.5
"""Iterations after which a weight that is looked for moves; the share of its way, in logarithms,
that it goes in each; and how far it goes, as a factor, from what it was at first."""

MIN_EXPLAINED_SHARE = 3e-3
"""Share of the data that a picture explains at least: its mean and its coarsest features."""

DataProx = Callable[[torch.Tensor, float], torch.Tensor]
"""The light in the frame with the least misfit + coupling / 2 * its squared distance to a light
that is given, pixel by pixel; of a light and a coupling."""


@dataclass(frozen=True)
class SplittingSettings:
    """How a splitting goes on.

    iterations: at most. tol: change of the picture, relative, below which it ends. weight: of the
    penalty; `initial_weight` to begin with, then what is found, if None.
    """

    iterations: int
    tol: float = 0.0
    weight: float | None = None
    initial_weight: float = 0.0


def damped_weight(
    target: float, weight: float, initial: float, max_factor: float = _MAX_WEIGHT_FACTOR
) -> float:
    """The next weight on the way to one that is wanted, not too far from the first."""
    target = min(max(target, initial / max_factor), initial * max_factor)
    return weight * (target / weight) ** _WEIGHT_DAMPING


class _DataTerm(ABC):
    """What the photograph wants of the picture."""

    def __init__(self, observation: Observation) -> None:
        self.observation = observation

    @abstractmethod
    def right_hand_side(self, data_coupling: float) -> torch.Tensor:
        """Spectrum of what it wants, times the coupling; not to be written over."""

    @abstractmethod
    def coupling(self, data_coupling: float) -> float: ...

    @abstractmethod
    def update(self, spectrum: torch.Tensor, data_coupling: float) -> None:
        """The next picture's spectrum, which may be written over."""

    @property
    @abstractmethod
    def mean_squared_residual(self) -> float:
        """Mean square of what the last picture leaves unexplained, over the noise's."""


class _FullPeriodData(_DataTerm):
    """All of a period was measured: nothing has to be split off."""

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
    """H x is split off: some of the period was measured, or its misfit isn't of squares."""

    def __init__(self, observation: Observation, data_prox: DataProx | None) -> None:
        super().__init__(observation)
        self._data_prox = data_prox or self._least_squares
        self._light = observation.extended_image.clone()
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
        light.add_(self._dual)
        wanted = self._data_prox(light, data_coupling)
        if seen.clipped is not None:
            # There the light is at least what was measured.
            wanted = torch.where(seen.clipped, torch.maximum(light, seen.normalised_image), wanted)
        torch.sub(light, wanted, out=self._dual)
        torch.sub(wanted, self._dual, out=light)

    def _least_squares(self, light: torch.Tensor, data_coupling: float) -> torch.Tensor:
        data, trust = self.observation.normalised_image, self.observation.effective_weights
        if trust is None:
            return torch.lerp(light, data, 1 / (1 + data_coupling))
        return (trust * data + data_coupling * light) / (trust + data_coupling)

    @property
    def mean_squared_residual(self) -> float:
        return self._mean_squared_residual


class Splitting:
    """The least of |H x - y|² / 2, trusted pixels alone, + weight * penalty(D x), of the pictures
    that the other priors allow. data_prox: of another misfit of H x than those squares.

    By the alternating direction method of multipliers (Boyd et al. 2011, doi 10.1561/2200000016)
    with H x and every D x split off (Almeida and Figueiredo 2013, doi 10.1109/TIP.2013.2258354):
    each step has a closed form, the picture's on frequencies, the data's on pixels, whatever the
    border and whichever pixels are missing.
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
        self._inverse: torch.Tensor | None = None
        self._inverse_for = 0.0

    def solve(self, method: str, progress: Progress) -> RestoredImage:
        steps, change = self._steps, list[float]()
        picture, converged = self._observation.extended_image, steps.tol == 0
        for number in range(steps.iterations):
            progress.report(number / steps.iterations, f"{method} {number + 1}/{steps.iterations}")
            before, picture = picture, self._picture()
            for prior in self._priors:
                prior.update(picture)
            if steps.weight is None and number >= _WEIGHT_DELAY:
                self._reweigh()
            change.append(relative_change(picture, before))
            if steps.tol and change[-1] <= steps.tol:
                converged = True
                break
        return RestoredImage(
            self._observation.crop_to_frame(picture).clamp(min=0),
            method,
            self._observation.noise,
            self._data.mean_squared_residual**0.5,
            self._weight,
            len(change),
            change,
            converged,
            picture,
        )

    def _picture(self) -> torch.Tensor:
        """The one that is nearest to what data and priors want."""
        held = _DATA_COUPLING * (self._weight / self._observation.scale) ** 0.5
        own = self._data.coupling(held)
        spectrum = self._right_hand_side(held, own).mul_(self._inverse_denominator(own))
        picture = irfft2(spectrum, self._observation.period_shape)
        self._data.update(spectrum, held)
        return picture

    def _right_hand_side(self, data_coupling: float, data_factor: float) -> torch.Tensor:
        """What they want, a spectrum that may be written over."""
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
        """By which that is divided, inverse; the same for as long as the weight is."""
        if self._inverse is None or self._inverse_for != self._weight:
            below = self._observation.squared_mtf * data_factor
            below.add_(_TINY * data_factor)
            for prior in self._priors:
                below.add_(prior.gram_spectrum, alpha=prior.coupling(self._weight, data_factor))
            self._inverse, self._inverse_for = below.reciprocal_(), self._weight
        return self._inverse

    def _reweigh(self) -> None:
        """Towards the weight by the evidence."""
        freedom = max(1 - self._data.mean_squared_residual, MIN_EXPLAINED_SHARE)
        wanted = self._penalty.estimate_weight(self._observation.scene_noise, freedom)
        self._weight = damped_weight(wanted, self._weight, self._steps.initial_weight)
