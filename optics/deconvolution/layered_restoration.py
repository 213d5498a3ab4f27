"""Joint restoration of all depth layers of a photograph, each with its own PSF."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch

from optics.deconvolution.band_coupling import BandCoupling
from optics.deconvolution.layered_observation import LayeredObservation
from optics.deconvolution.normal_equations import ConjugateGradientStep, LinearEquations
from optics.deconvolution.observation import Observation
from optics.deconvolution.own_terms import in_own_unit
from optics.deconvolution.priors import Box, DerivativePenalty, Prior
from optics.deconvolution.restored_image import RestoredImage
from optics.deconvolution.shrinkage import require_power
from optics.deconvolution.splitting import restored_image, solve_by_splitting
from optics.deconvolution.total_variation import (
    GRADIENT_THRESHOLD,
    light_in_weight,
    weight_settings,
)
from optics.fourier import irfft2, rfft2
from optics.operators.base import Operator
from optics.operators.blur import transfer_function
from optics.operators.gram import squared_modulus
from optics.operators.occluding import OccludingBlur
from optics.operators.varying import VaryingBlur
from optics.plane import centred_pad
from optics.progress import Progress
from optics.threads import single_threaded
from optics.validation import require_count, require_positive


@single_threaded
@torch.no_grad()
@in_own_unit(weight=light_in_weight)
def restore_layers(
    observation: LayeredObservation,
    weight: float | None = None,
    *,
    power: float = 1.0,
    occlusion: bool = True,
    iterations: int = 20,
    cg_steps: int = 10,
    tol: float = 0.0,
    positive: bool = False,
    progress: Progress | None = None,
) -> RestoredImage:
    """Restore a blurred photograph of several depth layers, each deconvolved with its own PSF.

    The result X minimises |H X - O|² / 2 + weight * the sum of |∇X|^power, where the first term
    counts trusted pixels only, and H blurs each depth layer by its PSF (thesis Fig. 2.17).

    The solver is the alternating direction method of multipliers with the gradients split off (Boyd
    et al. 2011, doi 10.1561/2200000016). The step for the picture has no closed form, since the
    PSFs differ. It is solved by conjugate gradients from the previous picture, preconditioned by
    the mean squared MTF of the layers. A clipped pixel counts where the blurred estimate is below
    the measured value.

    The model doesn't include depths beyond the frame, where the layers at its edge continue; errors
    of the map of layers; and what OccludingBlur neglects.

    Parameters
    ----------
    observation : LayeredObservation
        Photograph, PSFs and layers.
    weight : float, optional
        Regularisation weight, as for total_variation(). Estimated if None.
    power : float, optional
        Power of the gradients' lengths, above 0 and up to 1.
    occlusion : bool, optional
        Whether nearer layers, which come first, hide those behind them. Each layer is then
        estimated also where it is hidden, and the picture is composed of the visible parts.
    iterations : int, optional
        Largest number of iterations.
    cg_steps : int, optional
        Steps of conjugate gradients in each iteration.
    tol : float, optional
        Relative change of the picture at which the iteration ends; 0 for all iterations.
    positive : bool, optional
        Whether the light is kept from being negative in each iteration.
    progress : Progress, optional
        Receives reports, and can cancel the work.

    Returns
    -------
    RestoredImage
        The picture in the photograph's frame, never negative.

    Raises
    ------
    ValueError
        For a weight that isn't positive, a power outside 0 to 1, or no iteration.
    """
    if weight is not None:
        require_positive("weight", weight, "")
    require_power(power)
    require_count("iterations", iterations)
    require_count("cg_steps", cg_steps)
    step = _LayerStep(_LayerEquations(observation, occlusion), cg_steps)
    # The picture's step isn't exact, and over-relaxation would enlarge its error.
    penalty = DerivativePenalty(
        BandCoupling.separate(len(step.start())), observation.period_shape,
        GRADIENT_THRESHOLD * observation.scale, observation.image.dtype,
        power=power, relaxation=1.0,
    )  # fmt: skip
    bounds = [Box(observation.support)] if positive or observation.border == "dark" else []
    # The spectrum of a photograph with several depths predicts the weight poorly.
    settings = weight_settings(
        observation, penalty, weight, iterations, tol, power, is_predictable=False
    )
    solution = solve_by_splitting(
        step, [penalty, *bounds], settings, "depths", progress or Progress()
    )
    return restored_image(step, solution, "depths" + (", hiding each other" if occlusion else ""))


def paste_layers(
    observation: LayeredObservation, restore: Callable[[Observation], RestoredImage]
) -> torch.Tensor:
    """Deconvolve a photograph with each depth layer's PSF, and paste the layers' parts together.

    This is fast, but it is wrong where the blurred light of one layer covers another.
    """
    each = [restore(observation.as_single_layer(k)).image for k in range(len(observation.psfs))]
    return (torch.stack(each) * observation.shares).sum(0)


class _LayerEquations(LinearEquations):
    """The normal equations of the restoration of depth layers.

    They are (H* M H + K) x = H* M y + the priors' right-hand side, where M are the pixels' weights.
    x is one picture for each layer with occlusion, otherwise one picture.
    """

    observation: LayeredObservation

    def __init__(self, observation: LayeredObservation, occlusion: bool) -> None:
        super().__init__(observation)
        self.occlusion = occlusion
        psfs = observation.psfs / observation.psf_sum
        self._blur: Operator = (OccludingBlur if occlusion else VaryingBlur)(
            psfs, observation.period_shares
        )
        self._powers = observation.squared_mtf[None]
        if occlusion:
            self._powers = squared_modulus(transfer_function(psfs, observation.period_shape))
        self._weights = observation.effective_weights

    @property
    def squared_response(self) -> torch.Tensor:
        return self._powers

    @property
    def data_spectrum(self) -> torch.Tensor:
        return self._apply_adjoint(self.observation.normalised_image)

    def apply_data_gram(self, x: torch.Tensor) -> torch.Tensor:
        return self._apply_adjoint(self.observation.crop_to_frame(self._blurred_light(x)))

    def mean_squared_residual(self, spectrum: torch.Tensor) -> float:
        return self.observation.mean_squared_residual(self._blurred_light(spectrum))

    def weigh_clipped_pixels(self, spectra: torch.Tensor) -> None:
        """Update the weights of clipped pixels for the next step of depth-layer deconvolution.

        A clipped pixel has weight only where the blurred pictures are below the measured value.
        """
        seen = self.observation
        if seen.clipped is None:
            return
        light = seen.crop_to_frame(self._blurred_light(spectra))
        dim = (seen.clipped & (light < seen.normalised_image)).to(seen.image)
        weights = dim if seen.weights is None else dim * seen.weights
        effective = seen.effective_weights
        self._weights = weights if effective is None else effective + weights

    def _blurred_light(self, spectra: torch.Tensor) -> torch.Tensor:
        """Blur the deconvolved depth layers' pictures to one photograph on the whole period."""
        pictures = irfft2(spectra, self.observation.period_shape)
        light: torch.Tensor = self._blur(pictures if self.occlusion else pictures[0])
        return light

    def _apply_adjoint(self, frame: torch.Tensor) -> torch.Tensor:
        """Apply the adjoint blur of depth-layer deconvolution to light in the frame, weighted."""
        kept = frame if self._weights is None else frame * self._weights
        back: torch.Tensor = self._blur.adjoint(centred_pad(kept, self.observation.period_shape))
        return rfft2(back if self.occlusion else back[None])


class _LayerStep(ConjugateGradientStep):
    """The step for the pictures in the restoration of depth layers."""

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
        """Compose the visible parts of all deconvolved depth layers to one period-wide picture."""
        if not self._equations.occlusion:
            return picture
        return (picture * self._equations.observation.period_shares).sum(0, keepdim=True)
