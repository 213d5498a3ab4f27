"""The picture's step of a restoration with more bands than the sensor has channels.

What is split off is the blurred light of each channel, not that of each band: a sensor with three
kinds of filters has three channels, whatever the number of bands. At each frequency the step is a
small linear system, one unknown per channel, by the Woodbury identity. The prior may have another
coupling for each component of the bands, so that rare components converge as fast as common ones.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch

from optics.deconvolution.band_coupling import BandCoupling, transform_bands
from optics.deconvolution.light_split import DataProx, SplitLight, relative_coupling
from optics.deconvolution.observation import Observation
from optics.deconvolution.priors import Prior
from optics.deconvolution.splitting import PictureStep
from optics.fourier import irfft2, rfft2

_WEIGHT_CHANGE = 0.02
"""Relative change of the prior's weight up to which the linear systems are kept."""

_LEAST_GRAM = 1e-5
"""What is added to the squared frequency, in (radians/pixel)², so that the prior determines a
scene's mean spectrum as well; a tenth of the lowest frequency's on 600 pixels. Much less, and the
linear systems would need double precision."""


class ChannelStep(PictureStep):
    """The picture's step with the blurred light of each channel of the sensor split off.

    `bands` are the couplings of the penalty, whose axes diagonalise all priors. `iterations` is the
    number that is planned, and `data_prox` replaces the weighted squares.
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
        """Compute what the deconvolution's next steps share until the prior's weight changes.

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
        """Invert the deconvolution's matrix of the channels' light at each frequency.

        The matrix is A P⁻¹ A* + 1 / coupling, with the model A from components to the channels'
        light and the priors' penalty P. The result is (channels, channels, rows, columns).
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
        """Return the priors' part of the deconvolution's right-hand side, as components' spectra.

        It is None before the first splits.
        """
        total = None
        for prior, coupling in zip(priors, self._couplings, strict=True):
            if prior.adjoint_target is not None:
                own = prior.adjoint_target * coupling
                total = own if total is None else total.add_(own)
        return None if total is None else self._to_axes(rfft2(total))

    def _channel_light(self, components: torch.Tensor) -> torch.Tensor:
        """Return the spectra of the channels' blurred light of a deconvolved picture's components.

        They are (channels, rows, columns), and the picture's are (bands, rows, columns).
        """
        light = self._from_axes(components).mul_(self.observation.otf)
        return _transform_spectra(self._mixing, light)

    def _components_of_light(self, light: torch.Tensor) -> torch.Tensor:
        """Apply the adjoint of _channel_light() to the spectra of the channels' blurred light."""
        spread = _transform_spectra(self._mixing.mT, light)
        return self._to_axes(spread.mul_(self.observation.conjugate_otf))

    def _to_axes(self, spectra: torch.Tensor) -> torch.Tensor:
        """Return the components of the spectra of a deconvolved picture's bands, without scales."""
        return _transform_spectra(self._axes, spectra)

    def _from_axes(self, spectra: torch.Tensor) -> torch.Tensor:
        """Return the spectra of a deconvolved picture's bands from those of its components."""
        return _transform_spectra(self._axes.mT, spectra)


def _transform_spectra(matrix: torch.Tensor, spectra: torch.Tensor) -> torch.Tensor:
    """Multiply the bands of each frequency of a deconvolved picture by a real matrix."""
    parts = transform_bands(matrix, torch.view_as_real(spectra))
    return torch.view_as_complex(parts)


def _multiply(matrices: torch.Tensor, light: torch.Tensor) -> torch.Tensor:
    """Multiply a deconvolution's spectra of the channels by a matrix at each frequency.

    The matrices are (channels, channels, rows, columns), and the light (channels, rows, columns).
    """
    result = matrices[:, 0] * light[0]
    for column in range(1, len(light)):
        result.addcmul_(matrices[:, column], light[column])
    return result


def _invert_in_place(matrices: torch.Tensor) -> torch.Tensor:
    """Invert a deconvolution's positive definite matrices of all frequencies, in place.

    They are (n, n, rows, columns). Gauss and Jordan's elimination needs no pivots for such
    matrices, and treats all frequencies at once.
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
