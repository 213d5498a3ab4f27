"""The picture's step of an iteration by splitting, in closed form on frequencies.

It holds for as many bands as channels, for more of them, and where the light is split off.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch

from optics.fourier import irfft2, rfft2, rfft_column_weights
from optics.inverse.band_coupling import BandCoupling, transform_bands
from optics.inverse.observation import Observation
from optics.inverse.operator import squared_modulus
from optics.inverse.priors import RELAXATION, Prior
from optics.inverse.splitting import PictureStep

# Coupling of the blurred light's split, over the square root of weight over scale: the last
# number over that of iterations, within the first two. A strong coupling gets farthest in few
# iterations; a weak one is needed for what lies beyond the frame. Measured: of 0.25 to 8, these
# are the best for 8, 12, 20 and 30 iterations.
_LEAST_COUPLING, _MOST_COUPLING, _COUPLED_ITERATIONS = 0.5, 3.0, 20.0

# Largest coupling, times the squared radius of the PSF in pixels, where the scene goes on beyond
# the frame; and the number of iterations, over the square root of weight over scale, below which
# it is larger in proportion. Measured with seven PSFs, 6 to 60 iterations and two noises: of 0.1
# to 3, the best for a ring of 30 pixels is 0.1 to 0.2, for one of 12 it is 0.4 to 3.
_WIDE_COUPLING, _NOISY_ITERATIONS = 100.0, 500.0

# Factor on the coupling of the blurred light's split for photographs with a variance map, whose
# dim pixels have weights far above 1. Measured on nine photographs of three scenes with three
# PSFs: of 1, 4 and 16, the best for 30 iterations in the worst case; with 1, dim pixels aren't
# fitted yet.
_VARIED_COUPLING = 4.0

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
        filters = observation.relative_filters
        self._filter_power = 1.0 if filters is None else filters.square().sum(0)

    def update(self, light: torch.Tensor, held: float) -> None:
        """Update the split for the last picture's blurred light, which it takes over.

        light: (bands, rows, columns), on the period.
        held: the coupling.
        """
        seen, power, trust = (
            self._observation,
            self._filter_power,
            self._observation.effective_weights,
        )
        self.target, self.mean_squared_residual = light, seen.mean_squared_residual(light)
        light = seen.crop_to_frame(light)
        if self._split is not None:
            light.mul_(RELAXATION).add_(self._split, alpha=1 - RELAXATION)
        light.add_(self._dual)
        # What the proximal step of the data term adds, which is a share of the misfit for squares.
        left = seen.normalised_image - seen.sum_bands(light)
        if self._data_prox is not None:
            step = self._data_prox(light, held) - light
        else:
            step = left.mul(1 / (held + power) if trust is None else trust / (held + trust * power))
        if seen.clipped is not None:
            # The light of a clipped pixel is at least the measured value.
            step = torch.where(seen.clipped, left.clamp(min=0) / power, step)
        taken = seen.spread_to_bands(step)
        # The new split is light + taken, and the new dual variable is -taken.
        self._split = light + taken
        light.add_(taken, alpha=2)
        self._dual = taken.neg_()


def relative_coupling(observation: Observation, iterations: int, weight: float) -> float:
    """Return the blurred light's coupling over the square root of weight over scale."""
    coupling = min(max(_COUPLED_ITERATIONS / iterations, _LEAST_COUPLING), _MOST_COUPLING)
    varied = 1.0 if observation.variance is None else _VARIED_COUPLING
    if observation.border == "periodic":
        return varied * coupling
    noisy = _NOISY_ITERATIONS * (weight / observation.scale) ** 0.5 / iterations
    wide = max(noisy, 1.0) * _WIDE_COUPLING / max(observation.psf_radius, 1.0) ** 2
    return varied * min(coupling, wide)


class _BandStep(PictureStep):
    """The picture's step that is diagonal in frequency, with the light of each band split off.

    A photograph that is a whole period, with weighted squares, needs no split.
    """

    def __init__(
        self, observation: Observation, iterations: int, data_prox: DataProx | None
    ) -> None:
        super().__init__(observation)
        self._iterations, self._relative_coupling = iterations, 0.0
        self._inverse_for: float | None = None
        self._split: SplitLight | None = None
        if not observation.is_fully_measured or data_prox is not None:
            self._split = SplitLight(observation, self.start().clone(), data_prox)
        else:
            self._data = self._last_spectrum = rfft2(observation.normalised_image)[None]
            self._adjoint_data = self._data * observation.conjugate_otf

    def next_picture(self, priors: Sequence[Prior], weight: float) -> torch.Tensor:
        seen, shape = self.observation, self.observation.period_shape
        if self._split is None:
            held, pull = 1.0, self._adjoint_data
        else:
            if not self._relative_coupling:
                self._relative_coupling = relative_coupling(seen, self._iterations, weight)
            held = self._relative_coupling * (weight / seen.scale) ** 0.5
            pull = rfft2(self._split.target).mul_(seen.conjugate_otf).mul_(held)
        if self._inverse_for != weight:
            # This keeps frequencies at 0 that neither the blur nor a prior determines.
            penalty = torch.full((), 1e-9 * held).to(seen.squared_mtf)
            for prior in priors:
                penalty = penalty.add(prior.gram_spectrum, alpha=prior.coupling(weight, held))
            self._inverse = (seen.squared_mtf * held + penalty).reciprocal_()
            self._inverse_for = weight
        first, *others = priors
        if first.adjoint_target is None:
            spectrum = pull.clone()
        else:
            wanted, coupled = first.adjoint_target, first.coupling(weight, held)
            for prior in others:
                if prior.adjoint_target is not None:
                    share = prior.coupling(weight, held) / coupled
                    wanted = torch.add(wanted, prior.adjoint_target, alpha=share)
            spectrum = rfft2(wanted)
            torch.add(pull, spectrum, alpha=coupled, out=spectrum)
        spectrum.mul_(self._inverse)
        picture = irfft2(spectrum, shape)
        if self._split is None:
            self._last_spectrum = spectrum
        else:
            self._split.update(irfft2(spectrum.mul_(seen.otf), shape), held)
        return picture

    @property
    def mean_squared_residual(self) -> float:
        if self._split is not None:
            return self._split.mean_squared_residual
        left = squared_modulus(self._last_spectrum * self.observation.otf - self._data)
        rows, columns = self.observation.period_shape
        total = float((left * rfft_column_weights(columns)).sum())
        return total / (rows * columns) ** 2 / self.observation.scene_noise**2


# Relative change of the prior's weight up to which the linear systems are kept.
_WEIGHT_CHANGE = 0.02

# What is added to the squared frequency, in (radians/pixel)², so that the prior determines a
# scene's mean spectrum as well; a tenth of the lowest frequency's on 600 pixels. Much less, and
# the linear systems would need double precision.
_LEAST_GRAM = 1e-5


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
        self._axes = torch.eye(bands.bands) if bands.axes is None else bands.axes
        self._iterations, self._mixing = iterations, mixing.to(observation.image)
        self._split = SplitLight(channels, transform_bands(self._mixing, self.start()), data_prox)
        self._weight: float | None = None
        self._relative_coupling: float | None = None

    def next_picture(self, priors: Sequence[Prior], weight: float) -> torch.Tensor:
        if self._weight is None or abs(weight / self._weight - 1) > _WEIGHT_CHANGE:
            self._prepare(priors, weight)
        seen, light, total = self.observation, rfft2(self._split.target), None
        for prior, coupling in zip(priors, self._couplings, strict=True):
            if prior.adjoint_target is not None:
                own = prior.adjoint_target * coupling
                total = own if total is None else total.add_(own)
        left, pull = light, None
        if total is not None:
            # The priors' part of the right-hand side, and its light in the channels.
            pull = _transform_spectra(self._axes, rfft2(total))
            bands = _transform_spectra(self._axes.mT, pull * self._inverse_penalty)
            left = light - _transform_spectra(self._mixing, bands.mul_(seen.otf))
        change = self._inverse[:, 0] * left[0]
        for column in range(1, len(left)):
            change.addcmul_(self._inverse[:, column], left[column])
        spread = _transform_spectra(self._mixing.mT, change).mul_(seen.conjugate_otf)
        spectrum = _transform_spectra(self._axes, spread)
        if pull is not None:
            spectrum.add_(pull)
        spectrum.mul_(self._inverse_penalty)
        # The blurred light of the new picture, without blurring it.
        light.sub_(change, alpha=1 / self._held)
        self._split.update(irfft2(light, seen.period_shape), self._held)
        return irfft2(_transform_spectra(self._axes.mT, spectrum), seen.period_shape)

    @property
    def mean_squared_residual(self) -> float:
        return self._split.mean_squared_residual

    def _prepare(self, priors: Sequence[Prior], weight: float) -> None:
        """Compute what the next steps share until the prior's weight changes.

        That is the inverse of the priors' penalty P of each component and frequency, and of each
        frequency, the inverse of the system for the light of all channels, (channels, channels,
        rows, columns). Its matrix is A P⁻¹ A* + 1 / coupling, with the model A from components to
        the channels' light.
        """
        seen, otf = self.observation, self.observation.otf
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
        self._inverse_penalty = penalty.expand(len(self._axes), *otf.shape[1:]).reciprocal()
        rows = [
            _transform_spectra(self._axes, channel[:, None, None] * otf) for channel in self._mixing
        ]
        systems = otf.new_empty(len(rows), len(rows), *otf.shape[1:])
        for i, row in enumerate(rows):
            held = row * self._inverse_penalty
            for j in range(i + 1):
                systems[i, j] = (held * rows[j].conj()).sum(0)
                systems[j, i] = systems[i, j].conj()
            systems[i, i] += 1 / self._held
        self._inverse = _invert_in_place(systems)


def _transform_spectra(matrix: torch.Tensor, spectra: torch.Tensor) -> torch.Tensor:
    """Multiply the bands of each frequency by a real matrix."""
    parts = transform_bands(matrix, torch.view_as_real(spectra))
    return torch.view_as_complex(parts)


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
    """Choose the closed-form step that suits observation, data term and coupling of bands.

    iterations: the number that is planned.
    data_prox: replaces the weighted squares by another data term of the light in the frame.
    """
    if bands is not None and bands.scales is not None:
        return ChannelStep(observation, iterations, bands, data_prox)
    return _BandStep(observation, iterations, data_prox)
