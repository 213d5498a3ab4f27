"""The picture's step of a restoration by splitting that has a closed form on frequencies.

If the whole period was measured, the data term is diagonal in frequency. Otherwise the blurred
light is split off (Almeida and Figueiredo 2013, doi 10.1109/TIP.2013.2258354), so that its step
treats each pixel on its own, for any border, any missing pixels and any filters.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence

import torch

from optics.deconvolution.band_coupling import BandCoupling
from optics.deconvolution.channel_step import ChannelStep
from optics.deconvolution.light_split import DataProx, SplitLight, relative_coupling
from optics.deconvolution.observation import Observation
from optics.deconvolution.priors import Prior
from optics.deconvolution.splitting import PictureStep
from optics.fourier import irfft2, rfft2, rfft_column_weights
from optics.operators.gram import GramOperator, squared_modulus


def frequency_step(
    observation: Observation,
    iterations: int,
    data_prox: DataProx | None = None,
    bands: BandCoupling | None = None,
) -> PictureStep:
    """Return the closed-form picture's step of a restoration by splitting.

    `data_prox` replaces the weighted squares by another data term of the light in the frame.
    `iterations` is the number that is planned. `bands` is the coupling of the prior's bands.
    """
    if bands is not None and bands.scales is not None:
        return ChannelStep(observation, iterations, bands, data_prox)
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
    """The picture's step with the blurred light of each band split off."""

    def __init__(
        self, observation: Observation, iterations: int, data_prox: DataProx | None
    ) -> None:
        super().__init__(observation)
        self._iterations = iterations
        self._coupling: float | None = None
        self._split = SplitLight(observation, self.start().clone(), data_prox)

    def _couplings(self, weight: float) -> tuple[float, float]:
        if self._coupling is None:
            self._coupling = relative_coupling(self.observation, self._iterations, weight)
        held = self._coupling * (weight / self.observation.scale) ** 0.5
        return held, held

    def _pull(self, held: float) -> torch.Tensor:
        return rfft2(self._split.target).mul_(self.observation.conjugate_otf).mul_(held)

    def _finish(self, spectrum: torch.Tensor, held: float) -> None:
        seen = self.observation
        self._split.update(irfft2(spectrum.mul_(seen.otf), seen.period_shape), held)

    @property
    def mean_squared_residual(self) -> float:
        return self._split.mean_squared_residual
