"""Deblur all depth layers of a photograph together, each blurred by its own PSF."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import torch
from scipy.ndimage import distance_transform_edt

from optics.fourier import irfft2, rfft2
from optics.inverse.band_coupling import BandCoupling
from optics.inverse.blur import Border, OccludingBlur, VaryingBlur, layer_weights, transfer_function
from optics.inverse.noise import PowerLaw, fit_power_law
from optics.inverse.normal_equations import ConjugateGradientStep, LinearEquations
from optics.inverse.observation import Observation, require_psf
from optics.inverse.operator import Operator, squared_modulus
from optics.inverse.own_terms import in_own_unit
from optics.inverse.priors import Box, DerivativePenalty, Prior
from optics.inverse.restored_image import RestoredImage
from optics.inverse.splitting import restored_image, solve_by_splitting
from optics.inverse.total_variation import GRADIENT_THRESHOLD, weight_settings
from optics.plane import centred_pad
from optics.progress import Progress
from optics.threads import single_threaded
from optics.validation import (
    accepts_numpy,
    as_floating_point,
    require_count,
    require_finite,
    require_positive,
)

_SHARE_TOLERANCE = 1e-3  # largest deviation from 1 of the sum of a pixel's shares


@dataclass(frozen=True, eq=False)
class LayeredObservation(Observation):
    """The photograph of a scene with several depth layers: see build_layered_observation().

    psf: mean of all PSFs by area.
    psfs: PSF of each layer, (layers, rows, columns).
    shares: share of each layer in each pixel of the photograph, (layers, rows, columns).
    """

    psfs: torch.Tensor = field(default_factory=lambda: torch.empty(0))
    shares: torch.Tensor = field(default_factory=lambda: torch.empty(0))

    @cached_property
    def areas(self) -> torch.Tensor:
        """The share of the photograph that each layer covers, (layers,)."""
        return self.shares.mean((-2, -1))

    @property
    def psf_offset(self) -> tuple[int, int]:
        # The map of layers holds where the PSFs put the picture.
        return 0, 0

    @cached_property
    def period_shares(self) -> torch.Tensor:
        """The layers' shares on the whole period; beyond the frame, those of its nearest pixel."""
        rows, columns = (
            (torch.arange(whole) - (whole // 2 - n // 2)).clamp(0, n - 1)
            for whole, n in zip(self.period_shape, self.image.shape, strict=True)
        )
        return self.shares[:, rows][:, :, columns]

    @cached_property
    def squared_mtf(self) -> torch.Tensor:
        return self._squared_mtf_on(self.period_shape)

    def _fitted_power_law(self) -> PowerLaw:
        # The spectra of the layers add in power.
        shape = (int(self.image.shape[0]), int(self.image.shape[1]))
        image = self.inpainted_image * self.psf_sum
        law = fit_power_law(image, self._squared_mtf_on(shape))
        # Fine detail of a sharp layer looks like noise. Therefore the noise is estimated in the
        # most blurred layer, if that covers enough of the frame.
        powers = squared_modulus(transfer_function(self.psfs / self.psf_sum, shape))
        dullest = int(powers.mean((-2, -1)).argmin())
        # Its window is smooth, and rises from the layer's edge over 16 pixels.
        inside = self.shares[dullest].numpy() > 1 - _SHARE_TOLERANCE
        depth = distance_transform_edt(np.pad(inside, 1, mode="edge"))[1:-1, 1:-1]
        rise = torch.from_numpy(depth / 16).clamp(0, 1)
        region = (torch.pi * rise / 2).sin().square()
        if float(region.mean()) < 0.02:
            return law
        dull = fit_power_law(image, powers[dullest], region)
        return replace(
            law,
            noise_variance=dull.noise_variance,
            model_error_variance=dull.model_error_variance,
        )

    def as_single_layer(self, number: int) -> Observation:
        """Return the observation with one layer's PSF everywhere."""
        return Observation(
            self.image, self.psfs[number], self.noise, self.border, self.weights, self.clipped
        )

    def _squared_mtf_on(self, shape: tuple[int, int]) -> torch.Tensor:
        """Compute the layers' mean squared MTF on a period of `shape`, weighted by area."""
        powers = squared_modulus(transfer_function(self.psfs / self.psf_sum, shape))
        return (self.areas[:, None, None] * powers).sum(0)


@accepts_numpy
def build_layered_observation(
    image: torch.Tensor,
    psfs: torch.Tensor | Sequence[torch.Tensor],
    layers: torch.Tensor,
    noise: float | None = None,
    border: Border = "unknown",
    weights: torch.Tensor | None = None,
    clipped: torch.Tensor | None = None,
) -> LayeredObservation:
    """Gather the photograph, the depth layers and the PSF of each of them.

    The photograph is restored in double precision if `image` is double, otherwise in single.

    Parameters
    ----------
    image : torch.Tensor or numpy.ndarray, (rows, columns)
        The photograph, light per pixel.
    psfs : torch.Tensor or numpy.ndarray, (layers, rows, columns), or a sequence of (rows, columns)
        PSF of each layer, origin at n // 2; the nearest first if layers hide each other.
    layers : torch.Tensor or numpy.ndarray
        Number of the layer that each pixel shows, (rows, columns), from 0. Or the share of each
        layer in each pixel, (layers, rows, columns), not negative, which add up to 1.
    noise : float, optional
        Standard deviation of a pixel of weight 1. Estimated from the photograph if None.
    border : {"unknown", "dark", "periodic"}, default "unknown"
        What the scene does beyond the frame: see `Observation`.
    weights : torch.Tensor or numpy.ndarray, (rows, columns), optional
        Weight of each pixel in the data term: see `Observation`.
    clipped : torch.Tensor or numpy.ndarray of bool, (rows, columns), optional
        True where the well was full.

    Returns
    -------
    LayeredObservation
        An observation that `restore` takes. Its `psf` is the mean of all PSFs by area.

    Raises
    ------
    ValueError
        If shapes don't fit, if shares are negative or don't add up to 1, if a PSF has no light, or
        if `Observation` raises it.
    """
    image = as_floating_point(image)
    each = [torch.as_tensor(psf).to(image) for psf in psfs]
    if not each or any(psf.ndim != 2 for psf in each):
        raise ValueError("psfs must be one or more, each (rows, columns)")
    for psf in each:
        require_psf(psf)
    size = [max(psf.shape[axis] for psf in each) for axis in (0, 1)]
    stacked = torch.stack([centred_pad(psf, size) for psf in each])
    shares, count, shape = torch.as_tensor(layers), len(each), tuple(image.shape)
    require_finite("layers", shares)
    if tuple(shares.shape) == shape:
        shares = layer_weights(shares, count)
    elif tuple(shares.shape) != (count, *shape):
        raise ValueError(
            f"layers are {tuple(shares.shape)}; with {count} PSFs and an image of {shape} they "
            f"must be {shape} or {(count, *shape)}"
        )
    missed = float((shares.sum(0) - 1).abs().max())
    if float(shares.min()) < 0 or missed > _SHARE_TOLERANCE:
        raise ValueError(
            f"layers miss 1 by {missed:.2g} in places, or are negative; at each pixel they must "
            "add up to 1"
        )
    shares = shares.to(image)
    mean = (shares.mean((-2, -1))[:, None, None] * stacked).sum(0)
    return LayeredObservation(
        image,
        mean,
        noise if noise is None else float(noise),
        border,
        weights if weights is None else weights.to(image),
        clipped if clipped is None else clipped.to(torch.bool),
        psfs=stacked,
        shares=shares,
    )


@single_threaded
@torch.no_grad()
@in_own_unit(weight=1)
def restore_layers(
    observation: LayeredObservation,
    weight: float | None = None,
    *,
    occlusion: bool = True,
    iterations: int = 20,
    cg_steps: int = 10,
    progress: Progress | None = None,
) -> RestoredImage:
    """Deblur a photograph of several depth layers, each with its own PSF.

    The result X minimises |H X - O|² / 2 + weight * the sum of |∇X|, where the first term
    counts trusted pixels only, and H blurs each depth layer by its PSF (thesis Fig. 2.17). It is
    cut to be nowhere negative.

    Since the PSFs differ, the step for the picture has no closed form. It is solved by conjugate
    gradients from the previous picture, preconditioned by the mean squared MTF of the layers. A
    clipped pixel counts where the blurred estimate is below the measured value.

    The model doesn't include depths beyond the frame, where the layers at its edge continue; errors
    of the map of layers; and what OccludingBlur neglects.

    Raises ValueError for a weight that isn't positive, or no iteration.

    weight: regularisation weight, as for total_variation(). Estimated if None.
    occlusion: whether nearer layers, which come first, hide those behind them. Each layer is then
        estimated also where it is hidden, and the picture is composed of the visible parts.
    iterations: largest number of iterations.
    cg_steps: steps of conjugate gradients in each iteration.
    """
    if weight is not None:
        require_positive("weight", weight, "")
    require_count("iterations", iterations)
    require_count("cg_steps", cg_steps)
    step = _LayerStep(_LayerEquations(observation, occlusion), cg_steps)
    # The picture's step isn't exact, and over-relaxation would enlarge its error.
    penalty = DerivativePenalty(
        BandCoupling.separate(len(step.start())), observation.period_shape,
        GRADIENT_THRESHOLD * observation.scale, observation.image.dtype,
        relaxation=1.0,
    )  # fmt: skip
    bounds = [Box(observation.support)] if observation.border == "dark" else []
    # The spectrum of a photograph with several depths predicts the weight poorly.
    settings = weight_settings(observation, penalty, weight, iterations, is_predictable=False)
    solution = solve_by_splitting(
        step, [penalty, *bounds], settings, "depths", progress or Progress()
    )
    return restored_image(step, solution, "depths" + (", hiding each other" if occlusion else ""))


def paste_layers(
    observation: LayeredObservation, restore: Callable[[Observation], RestoredImage]
) -> torch.Tensor:
    """Deblur a photograph with each layer's PSF, and paste the layers' parts together.

    This is fast, but it is wrong where the blurred light of one layer covers another.
    """
    each = [restore(observation.as_single_layer(k)).image for k in range(len(observation.psfs))]
    return (torch.stack(each) * observation.shares).sum(0)


class _LayerEquations(LinearEquations):
    """The equations of all layers; with occlusion x is one picture for each, otherwise one."""

    observation: LayeredObservation

    def __init__(self, observation: LayeredObservation, occlusion: bool) -> None:
        super().__init__(observation)
        self.occlusion = occlusion
        psfs = observation.psfs / observation.psf_sum
        self._blur: Operator = (OccludingBlur if occlusion else VaryingBlur)(
            psfs, observation.period_shares
        )
        self.squared_response = observation.squared_mtf[None]
        if occlusion:
            powers = squared_modulus(transfer_function(psfs, observation.period_shape))
            self.squared_response = powers
        self._weights = observation.effective_weights

    @property
    def data_spectrum(self) -> torch.Tensor:
        return self._apply_adjoint(self.observation.normalised_image)

    def apply_data_gram(self, x: torch.Tensor) -> torch.Tensor:
        return self._apply_adjoint(self.observation.crop_to_frame(self._blurred_light(x)))

    def mean_squared_residual(self, spectrum: torch.Tensor) -> float:
        return self.observation.mean_squared_residual(self._blurred_light(spectrum))

    def weigh_clipped_pixels(self, spectra: torch.Tensor) -> None:
        """Give clipped pixels weight where the blurred pictures are below the measured value."""
        seen = self.observation
        if seen.clipped is None:
            return
        light = seen.crop_to_frame(self._blurred_light(spectra))
        dim = (seen.clipped & (light < seen.normalised_image)).to(seen.image)
        weights = dim if seen.weights is None else dim * seen.weights
        effective = seen.effective_weights
        self._weights = weights if effective is None else effective + weights

    def _blurred_light(self, spectra: torch.Tensor) -> torch.Tensor:
        """Blur the layers' pictures to one photograph on the whole period."""
        pictures = irfft2(spectra, self.observation.period_shape)
        light: torch.Tensor = self._blur(pictures if self.occlusion else pictures[0])
        return light

    def _apply_adjoint(self, frame: torch.Tensor) -> torch.Tensor:
        """Apply the adjoint blur to light in the frame, weighted."""
        kept = frame if self._weights is None else frame * self._weights
        back: torch.Tensor = self._blur.adjoint(centred_pad(kept, self.observation.period_shape))
        return rfft2(back if self.occlusion else back[None])


class _LayerStep(ConjugateGradientStep):
    """The step for the layers' pictures, by conjugate gradients."""

    _equations: _LayerEquations

    def next_picture(self, priors: Sequence[Prior], weight: float) -> torch.Tensor:
        pictures = super().next_picture(priors, weight)
        self._equations.weigh_clipped_pixels(self._spectrum)
        return pictures

    def start(self) -> torch.Tensor:
        shares = self._equations.observation.shares
        count = len(shares) if self._equations.occlusion else 1
        return super().start().expand(count, -1, -1)

    def visible_picture(self, picture: torch.Tensor) -> torch.Tensor:
        """Compose the visible parts of all layers to one picture on the whole period."""
        if not self._equations.occlusion:
            return picture
        return (picture * self._equations.observation.period_shares).sum(0, keepdim=True)
