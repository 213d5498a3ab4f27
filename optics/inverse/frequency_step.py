"""The picture's step of an iteration by splitting, in closed form on frequencies.

It holds for as many bands as channels, for more of them, and where the light is split off.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence

import torch

from optics.fourier import irfft2, rfft2, rfft_column_weights
from optics.inverse.band_coupling import BandCoupling, transform_bands
from optics.inverse.observation import Observation
from optics.inverse.operator import GramOperator, squared_modulus
from optics.inverse.priors import RELAXATION, Prior
from optics.inverse.splitting import PictureStep

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

VARIED_COUPLING = 4.0
"""Factor on the coupling of the blurred light's split for photographs with a variance map, whose
dim pixels have weights far above 1. Measured on nine photographs of three scenes with three PSFs:
of 1, 4 and 16, the best for 30 iterations in the worst case; with 1, dim pixels aren't fitted yet.
"""

DataProx = Callable[[torch.Tensor, float], torch.Tensor]
"""The proximal step of a data term. For a light in the frame and a coupling, it returns the light
that minimises data term + coupling / 2 * its squared distance to the given light, pixel by pixel.
"""


class SplitLight:
    """The blurred light, split off from the picture and pulled to the photograph.

    target: the split less its dual variable, (bands, rows, columns) on the period: what the next
        picture's light should be.
    mean_squared_residual: of the last picture, relative to the noise variance.
    """

    def __init__(
        self, observation: Observation, start: torch.Tensor, data_prox: DataProx | None = None
    ) -> None:
        self._observation, self._data_prox = observation, data_prox
        self.target, self.mean_squared_residual = start, 1.0
        self._split: torch.Tensor | None = None
        self._dual = torch.zeros_like(observation.crop_to_frame(start))

    def update(self, light: torch.Tensor, held: float) -> None:
        """Update the split for the last picture's blurred light, which it takes over.

        light: (bands, rows, columns), on the period.
        held: the coupling.
        """
        seen = self._observation
        self.target, self.mean_squared_residual = light, seen.mean_squared_residual(light)
        light = seen.crop_to_frame(light)
        if self._split is not None:
            light.mul_(RELAXATION).add_(self._split, alpha=1 - RELAXATION)
        light.add_(self._dual)
        taken = self._step_to_data(light, held)
        # The new split is light + taken, and the new dual variable is -taken.
        self._split = light + taken
        light.add_(taken, alpha=2)
        self._dual = taken.neg_()

    def _step_to_data(self, light: torch.Tensor, held: float) -> torch.Tensor:
        """Return what the proximal step of the data term adds to light."""
        seen = self._observation
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
        seen, trust = self._observation, self._observation.effective_weights
        if trust is None:
            return 1 / (held + seen.filter_power)
        return trust / (held + trust * seen.filter_power)


def relative_coupling(observation: Observation, iterations: int, weight: float) -> float:
    """Return the blurred light's coupling over the square root of weight over scale."""
    coupling = min(max(COUPLED_ITERATIONS / iterations, LEAST_COUPLING), MOST_COUPLING)
    varied = 1.0 if observation.variance is None else VARIED_COUPLING
    if observation.border == "periodic":
        return varied * coupling
    noisy = NOISY_ITERATIONS * (weight / observation.scale) ** 0.5 / iterations
    wide = max(noisy, 1.0) * WIDE_COUPLING / max(observation.psf_radius, 1.0) ** 2
    return varied * min(coupling, wide)


_WEIGHT_CHANGE = 0.02
"""Relative change of the prior's weight up to which the linear systems are kept."""

_LEAST_GRAM = 1e-5
"""What is added to the squared frequency, in (radians/pixel)², so that the prior determines a
scene's mean spectrum as well; a tenth of the lowest frequency's on 600 pixels. Much less, and the
linear systems would need double precision."""


class ChannelStep(PictureStep):
    """The picture's step with the blurred light of each channel of the sensor split off.

    iterations: the number that is planned.
    bands: couplings of the penalty, whose axes diagonalise all priors.
    data_prox: replaces the weighted squares.
    """

    def __init__(
        self,
        observation: Observation,
        iterations: int,
        bands: BandCoupling,
        data_prox: DataProx | None = None,
    ) -> None:
        super().__init__(observation)
        channels, mixing = observation.channels
        axes = torch.eye(bands.bands) if bands.axes is None else bands.axes
        self._iterations, self._axes = iterations, axes
        self._mixing = mixing.to(observation.image)
        light = transform_bands(self._mixing, self.start())
        self._split = SplitLight(channels, light, data_prox)
        self._weight: float | None = None
        self._relative_coupling: float | None = None

    def next_picture(self, priors: Sequence[Prior], weight: float) -> torch.Tensor:
        if self._weight is None or abs(weight / self._weight - 1) > _WEIGHT_CHANGE:
            self._prepare(priors, weight)
        seen, light = self.observation, rfft2(self._split.target)
        left, pull = light, self._prior_pull(priors)
        if pull is not None:
            left = light - self._channel_light(pull * self._inverse_penalty)
        change = _multiply(self._inverse, left)
        spectrum = self._components_of_light(change)
        if pull is not None:
            spectrum.add_(pull)
        spectrum.mul_(self._inverse_penalty)
        # The blurred light of the new picture, without blurring it.
        light.sub_(change, alpha=1 / self._held)
        self._split.update(irfft2(light, seen.period_shape), self._held)
        return irfft2(self._from_axes(spectrum), seen.period_shape)

    @property
    def mean_squared_residual(self) -> float:
        return self._split.mean_squared_residual

    def _prepare(self, priors: Sequence[Prior], weight: float) -> None:
        """Compute what the next steps share until the prior's weight changes.

        That is the inverse of the priors' penalty of each component and frequency, and with it, of
        each frequency, the inverse matrix of the system for the light of all channels.
        """
        seen = self.observation
        if self._relative_coupling is None:
            self._relative_coupling = relative_coupling(seen, self._iterations, weight)
        self._weight = weight
        self._held = self._relative_coupling * (weight / seen.scale) ** 0.5
        penalty = torch.zeros(()).to(seen.squared_mtf)
        self._couplings = [prior.coupling(weight, self._held) for prior in priors]
        for prior, coupling in zip(priors, self._couplings, strict=True):
            own = (prior.gram_spectrum + _LEAST_GRAM) * coupling
            if prior.component_scales is not None:
                own = own * prior.component_scales.to(own).square()[:, None, None]
            penalty = penalty + own
        self._inverse_penalty = penalty.expand(len(self._axes), *seen.otf.shape[1:]).reciprocal()
        self._inverse = self._invert_systems()

    def _invert_systems(self) -> torch.Tensor:
        """Invert the matrix of the channels' light at each frequency.

        The result is (channels, channels, rows, columns). The matrix is A P⁻¹ A* + 1 / coupling,
        with the model A from components to the channels' light and the priors' penalty P.
        """
        otf = self.observation.otf
        rows = [self._to_axes(channel[:, None, None] * otf) for channel in self._mixing]
        count = len(rows)
        systems = otf.new_empty(count, count, *otf.shape[1:])
        for i in range(count):
            held = rows[i] * self._inverse_penalty
            for j in range(i + 1):
                systems[i, j] = (held * rows[j].conj()).sum(0)
                systems[j, i] = systems[i, j].conj()
            systems[i, i] += 1 / self._held
        return _invert_in_place(systems)

    def _prior_pull(self, priors: Sequence[Prior]) -> torch.Tensor | None:
        """Return the priors' part of the right-hand side, as components' spectra; None at first."""
        total = None
        for prior, coupling in zip(priors, self._couplings, strict=True):
            if prior.adjoint_target is not None:
                own = prior.adjoint_target * coupling
                total = own if total is None else total.add_(own)
        return None if total is None else self._to_axes(rfft2(total))

    def _channel_light(self, components: torch.Tensor) -> torch.Tensor:
        """Return the spectra of the channels' blurred light, (channels, rows, columns).

        components: spectra of the picture's components, (bands, rows, columns).
        """
        light = self._from_axes(components).mul_(self.observation.otf)
        return _transform_spectra(self._mixing, light)

    def _components_of_light(self, light: torch.Tensor) -> torch.Tensor:
        """Apply the adjoint of _channel_light()."""
        spread = _transform_spectra(self._mixing.mT, light)
        return self._to_axes(spread.mul_(self.observation.conjugate_otf))

    def _to_axes(self, spectra: torch.Tensor) -> torch.Tensor:
        """Return the components of the bands' spectra, without scales."""
        return _transform_spectra(self._axes, spectra)

    def _from_axes(self, spectra: torch.Tensor) -> torch.Tensor:
        """Return the bands' spectra from those of the components."""
        return _transform_spectra(self._axes.mT, spectra)


def _transform_spectra(matrix: torch.Tensor, spectra: torch.Tensor) -> torch.Tensor:
    """Multiply the bands of each frequency by a real matrix."""
    parts = transform_bands(matrix, torch.view_as_real(spectra))
    return torch.view_as_complex(parts)


def _multiply(matrices: torch.Tensor, light: torch.Tensor) -> torch.Tensor:
    """Multiply the channels' spectra by a matrix at each frequency.

    matrices: (channels, channels, rows, columns).
    light: (channels, rows, columns).
    """
    result = matrices[:, 0] * light[0]
    for column in range(1, len(light)):
        result.addcmul_(matrices[:, column], light[column])
    return result


def _invert_in_place(matrices: torch.Tensor) -> torch.Tensor:
    """Invert the positive definite matrices of all frequencies, (n, n, rows, columns), in place.

    Gauss and Jordan's elimination needs no pivots for such matrices, and treats all frequencies at
    once.
    """
    for k in range(len(matrices)):
        pivot = matrices[k, k].reciprocal()
        row = matrices[k] * pivot
        row[k] = pivot
        for i in range(len(matrices)):
            if i != k:
                factor = matrices[i, k].clone()
                matrices[i, k] = 0
                matrices[i].addcmul_(factor, row, value=-1)
        matrices[k] = row
    return matrices


def frequency_step(
    observation: Observation,
    iterations: int,
    data_prox: DataProx | None = None,
    bands: BandCoupling | None = None,
) -> PictureStep:
    """Choose the closed-form step that suits observation, data term and bands.

    iterations: the number that is planned.
    data_prox: replaces the weighted squares by another data term of the light in the frame.
    bands: coupling of the prior's bands.
    """
    if bands is not None and bands.scales is not None:
        return ChannelStep(observation, iterations, bands, data_prox)
    if observation.is_fully_measured and data_prox is None:
        return _FullPeriodStep(observation)
    return _SplitLightStep(observation, iterations, data_prox)


class _FrequencyStep(PictureStep):
    """Base class of the picture's steps that are diagonal in frequency."""

    def __init__(self, observation: Observation) -> None:
        super().__init__(observation)
        self._inverse: GramOperator | None = None
        self._inverse_for = 0.0

    @abstractmethod
    def _couplings(self, weight: float) -> tuple[float, float]:
        """Return the coupling of the blurred light, and the factor of |H|²."""

    @abstractmethod
    def _pull(self, held: float) -> torch.Tensor:
        """Return the photograph's part of the right-hand side, a spectrum that callers must keep.

        held: the coupling.
        """

    @abstractmethod
    def _finish(self, spectrum: torch.Tensor, held: float) -> None:
        """Update the split of the data term; it may overwrite the spectrum."""

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
        """Add up the parts of photograph and priors, in a spectrum that callers may overwrite."""
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
        """Return the inverse of the normal equations, kept until the weight changes.

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
