"""Demosaicing of all bands together, with a convex prior on brightness and colour differences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch

from optics.deconvolution.border import extend_periodically
from optics.deconvolution.restored_image import relative_change
from optics.demosaicing.colour_prior import CurvaturePrior
from optics.demosaicing.mosaic_observation import MosaicObservation
from optics.fourier import irfft2, rfft2
from optics.progress import Progress
from optics.threads import single_threaded


@dataclass(frozen=True)
class DemosaicingSettings:
    """Tune the prior and the splitting of the demosaicing of all bands together.

    All values are chosen.

    Attributes
    ----------
    brightness : float
        Weight of the brightness' curvature relative to that of the colour differences.
    curvature_threshold : float
        Curvature that one iteration sets to zero, relative to the standard deviation of the light.
    noiseless_weight : float
        Regularisation weight of a picture without noise, relative to the scale of the light.
    noise_weight : float
        Factor of the squared relative noise, which is added to `noiseless_weight`.
    """

    brightness: float = 0.4
    curvature_threshold: float = 0.5
    noiseless_weight: float = 1e-3
    noise_weight: float = 2.2


_SETTINGS = DemosaicingSettings()


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
    """Demosaic an observation with the curvature prior; return light of (bands, rows, columns).

    The result x minimises |S G x - y|² / 2 + weight * P(x), where S are the filters, G is the blur,
    P is CurvaturePrior, and the first term counts trusted pixels only. `period` is the period of
    the filter pattern in (rows, columns).

    The solver is the alternating direction method of multipliers (Boyd et al. 2011, doi
    10.1561/2200000016). The curvatures and the light before the filters are split off, so that
    each step has a closed form. The filters' step treats each pixel on its own (Sherman-Morrison
    formula).
    """
    splitting = _Splitting(observation, period, weight)
    progress = progress or Progress()
    for number in range(iterations):
        progress.report(number / iterations, f"demosaicing {number + 1}/{iterations}")
        splitting.step()
    return splitting.picture()


def default_weight(noise: float, scale: float) -> float:
    """Return the demosaicing prior's default weight for a noise and a scale of the light."""
    return scale * (_SETTINGS.noiseless_weight + _SETTINGS.noise_weight * (noise / scale) ** 2)


class _Splitting:
    """The state of the demosaicing's ADMM between two iterations.

    The data and the filters are divided by the gain of the filters.
    """

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
        step = _SETTINGS.curvature_threshold * observation.scale
        # With this coupling of both splits, the prior's threshold is `step`.
        self._coupling = used / step
        bands = len(observation.filters)
        self._curvature_prior = CurvaturePrior(
            bands, observation.period_shape, _SETTINGS.brightness, step, self._data.dtype
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
        """Do one iteration of the demosaicing: update the picture, then both splits."""
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
        """Return the demosaiced picture in the frame, (bands, rows, columns)."""
        return self._observation.crop_to_frame(self._x).clone()

    def _to_colour_axes(self, x: torch.Tensor) -> torch.Tensor:
        return _transform_bands(self._curvature_prior.colour_axes, x)

    def _blur(self, spectrum: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
        """Return the blurred light before the mosaic's filters; callers may overwrite it."""
        transfer = self._observation.otf
        return (
            x.clone()
            if transfer is None
            else irfft2(spectrum * transfer, self._observation.period_shape)
        )

    def _update_data_split(self, light: torch.Tensor) -> torch.Tensor:
        """Update the demosaicing's split v of the light before the mosaic's filters; return v - u.

        u is the dual variable of v. Outside the frame, where nothing was measured, the light is
        returned as it is.
        """
        inside = self._observation.crop_to_frame(light)
        moved = inside + self._dual
        left = self._data - (self._filters * moved).sum(0)
        if self._observation.clipped is not None:
            trust = torch.where(self._observation.clipped, (left > 0).to(left), self._pixel_weights)
        else:
            trust = self._pixel_weights
        below = self._coupling + trust * self._filters.square().sum(0)
        taken = self._filters * (trust * left / below)
        # The new v is moved + taken and the new u is -taken, so v - u is moved + 2 * taken.
        self._dual = -taken
        inside.copy_(moved.add_(taken, alpha=2))
        return light

    def _invert_normal_matrix(self) -> torch.Tensor:
        """Invert G* G + D^T D of the demosaicing at each frequency.

        If all bands have the same PSF, the matrix is diagonal on the colour axes and the result is
        (bands, rows, columns). Otherwise it is one matrix (bands, bands) per frequency.
        """
        # A small number keeps the inverse finite at frequencies that neither term constrains.
        tiny = 1e-9
        bends, transfer = self._curvature_prior, self._observation.otf
        weights = bends.weights.square()
        if transfer is None or len(transfer) == 1:
            power = 1.0 if transfer is None else transfer.abs().square()
            return (weights[:, None, None] * bends.gram_spectrum + power + tiny).reciprocal_()
        shared = bends.colour_axes.mT @ (weights[:, None] * bends.colour_axes)
        own = torch.diag_embed(transfer.abs().square().movedim(0, -1) + tiny)
        return torch.linalg.inv(own + bends.gram_spectrum[..., None, None] * shared)

    def _solve_spectrum(self, right_hand_side: torch.Tensor) -> torch.Tensor:
        """Solve a demosaicing step for the spectrum of the colour picture.

        The solution is the spectrum of the right-hand side times the inverse of the normal matrix.
        """
        if self._inverse.ndim == 3:
            colours = self._curvature_prior.colour_axes
            return _transform_bands(
                colours.mT, _transform_bands(colours, right_hand_side).mul_(self._inverse)
            )
        matrix = self._inverse.to(right_hand_side.dtype)
        return (matrix @ right_hand_side.movedim(0, -1)[..., None])[..., 0].movedim(-1, 0)


def _transform_bands(matrix: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
    """Multiply the bands of each pixel of a demosaiced picture by a matrix."""
    return torch.tensordot(matrix.to(x.dtype), x, 1)
