"""All bands at once, by a convex prior on brightness and colours."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from optics.deconvolution.border import extend_periodically
from optics.deconvolution.restored_image import relative_change
from optics.demosaicing.colour_prior import CurvaturePrior
from optics.demosaicing.mosaic_observation import MosaicObservation
from optics.fourier import irfft2, rfft2
from optics.progress import Progress
from optics.threads import single_threaded

_BRIGHTNESS = 0.4
"""Weight of brightness' curvature beside that of colours."""

_CURVATURE_THRESHOLD = 0.5
"""Of the light's standard deviation: the curvature that a first iteration takes for none."""

_NOISELESS_WEIGHT, _NOISE_WEIGHT = 1e-3, 2.2
"""Weights on the light's scale: of a picture without noise, and a noise's square to be added."""

_TINY = 1e-9


@single_threaded
@torch.no_grad()
def demosaic_with_prior(
    observation: MosaicObservation,
    period: Sequence[int],
    weight: float | None = None,
    *,
    iterations: int = 30,
    progress: Progress | None = None,
) -> torch.Tensor:
    """(bands, rows, columns) of light: the least of |S G x - y|² / 2 + weight * P(x), P being
    CurvaturePrior, trusted
    pixels alone.

    By the alternating direction method of multipliers (Boyd et al. 2011, doi 10.1561/2200000016):
    curvatures and the light before the filters are split off, and each step has a closed form, the
    filters' a pixel's own (Sherman and Morrison's). period: of the pattern, (rows, columns).
    """
    splitting = _Splitting(observation, period, weight)
    progress = progress or Progress()
    for number in range(iterations):
        progress.report(number / iterations, f"demosaicing {number + 1}/{iterations}")
        splitting.step()
    return splitting.picture()


def default_weight(noise: float, scale: float) -> float:
    """Of the prior, for a noise and a scale of the light."""
    return scale * (_NOISELESS_WEIGHT + _NOISE_WEIGHT * (noise / scale) ** 2)


class _Splitting:
    """The state between two iterations, of light over the filters' gain."""

    def __init__(
        self, observation: MosaicObservation, period: Sequence[int], weight: float | None
    ) -> None:
        self._observation, gain = observation, observation.filter_gain
        self._filters, self._data = observation.filters / gain, observation.raw / gain
        self._pixel_weights = (
            torch.ones_like(self._data)
            if observation.pixel_weights is None
            else observation.pixel_weights
        )
        used = (
            default_weight(observation.noise / gain, observation.scale)
            if weight is None
            else weight
        )
        step = _CURVATURE_THRESHOLD * observation.scale
        # Coupling of both splits: it makes one step of the length that is told.
        self._coupling = used / step
        bands = len(observation.filters)
        self._curvature_prior = CurvaturePrior(
            bands, observation.period_shape, _BRIGHTNESS, step, self._data.dtype
        )
        self._inverse = self._invert_normal_matrix()
        self._x = torch.stack(
            [
                extend_periodically(one, observation.period_shape)
                for one in observation.initial_bands(period)
            ]
        )
        self._dual = torch.zeros((bands, *observation.frame_shape), dtype=self._data.dtype)
        self.change: list[float] = []
        self._prior_target = self._curvature_prior.update(self._to_colour_axes(self._x))
        self._light = self._update_data_split(self._blur(rfft2(self._x), self._x))

    def step(self) -> None:
        colours = self._curvature_prior.colour_axes
        pulled = rfft2(self._light)
        if self._observation.otf is not None:
            pulled = pulled * self._observation.otf.conj()
        wanted = pulled + rfft2(_transform_bands(colours.mT, self._prior_target))
        spectrum = self._solve_spectrum(wanted)
        before, self._x = self._x, irfft2(spectrum, self._observation.period_shape)
        self.change.append(relative_change(self._x.flatten(0, 1), before.flatten(0, 1)))
        self._prior_target = self._curvature_prior.update(self._to_colour_axes(self._x))
        self._light = self._update_data_split(self._blur(spectrum, self._x))

    def picture(self) -> torch.Tensor:
        return self._observation.crop_to_frame(self._x).clone()

    def _to_colour_axes(self, x: torch.Tensor) -> torch.Tensor:
        return _transform_bands(self._curvature_prior.colour_axes, x)

    def _blur(self, spectrum: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
        """The light before the filters; may be written over."""
        transfer = self._observation.otf
        return (
            x.clone()
            if transfer is None
            else irfft2(spectrum * transfer, self._observation.period_shape)
        )

    def _update_data_split(self, light: torch.Tensor) -> torch.Tensor:
        """v - u of the next step: what the numbers make of the light, and what it was pulled."""
        inside = self._observation.crop_to_frame(light)
        moved = inside + self._dual
        left = self._data - (self._filters * moved).sum(0)
        if self._observation.clipped is not None:
            trust = torch.where(self._observation.clipped, (left > 0).to(left), self._pixel_weights)
        else:
            trust = self._pixel_weights
        below = self._coupling + trust * self._filters.square().sum(0)
        taken = self._filters * (trust * left / below)
        # u is now -taken, and v - u is twice that from where it was moved.
        self._dual = -taken
        inside.copy_(moved.add_(taken, alpha=2))
        return light

    def _invert_normal_matrix(self) -> torch.Tensor:
        """Of G* G + D^T D: of each colour where all bands are blurred alike, else of all bands,
        (bands, bands) a frequency."""
        bends, transfer = self._curvature_prior, self._observation.otf
        weights = bends.weights.square()
        if transfer is None or len(transfer) == 1:
            power = 1.0 if transfer is None else transfer.abs().square()
            return (weights[:, None, None] * bends.gram_spectrum + power + _TINY).reciprocal_()
        shared = bends.colour_axes.mT @ (weights[:, None] * bends.colour_axes)
        own = torch.diag_embed(transfer.abs().square().movedim(0, -1) + _TINY)
        return torch.linalg.inv(own + bends.gram_spectrum[..., None, None] * shared)

    def _solve_spectrum(self, right_hand_side: torch.Tensor) -> torch.Tensor:
        if self._inverse.ndim == 3:
            colours = self._curvature_prior.colour_axes
            return _transform_bands(
                colours.mT, _transform_bands(colours, right_hand_side).mul_(self._inverse)
            )
        matrix = self._inverse.to(right_hand_side.dtype)
        return (matrix @ right_hand_side.movedim(0, -1)[..., None])[..., 0].movedim(-1, 0)


def _transform_bands(matrix: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
    """A matrix times the bands of each pixel."""
    return torch.tensordot(matrix.to(x.dtype), x, 1)
