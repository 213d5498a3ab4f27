"""Joint restoration of all depth layers of a photograph, each with its own PSF."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch

from optics.deconvolution.layered_observation import LayeredObservation
from optics.deconvolution.noise import squared_modulus
from optics.deconvolution.normal_equations import solve_on_frequencies
from optics.deconvolution.observation import Observation
from optics.deconvolution.priors import NonNegativity, Prior, TotalVariation
from optics.deconvolution.restored_image import RestoredImage, has_converged, relative_change
from optics.deconvolution.shrinkage import require_power
from optics.deconvolution.splitting import damped_weight
from optics.deconvolution.total_variation import GRADIENT_THRESHOLD, initial_weight
from optics.deconvolution.wiener import penalty_of
from optics.fourier import irfft2, rfft2, rfft_column_weights
from optics.operators.base import Operator
from optics.operators.blur import transfer_function
from optics.operators.occluding import OccludingBlur
from optics.operators.varying import VaryingBlur
from optics.plane import centred_pad
from optics.progress import Progress
from optics.threads import single_threaded
from optics.validation import require_count, require_positive


@single_threaded
@torch.no_grad()
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
    progress, equations = progress or Progress(), _LayerEquations(observation, occlusion)
    priors = [_PicturePriors(observation, power, positive) for _ in range(equations.picture_count)]
    first = initial_weight(observation, power)
    used, change, ended = first if weight is None else weight, list[float](), False
    pictures = observation.extended_image.expand(
        equations.picture_count, *observation.period_shape
    ).clone()
    spectra = rfft2(pictures)
    # The spectrum of a photograph with several depths predicts the weight poorly. Therefore the
    # weight may move by a large factor, from the fourth iteration on.
    weight_delay, max_weight_factor = 3, 8.0
    for number in range(iterations):
        progress.report(number / iterations, f"depths {number + 1}/{iterations}")
        below = torch.stack([one.denominator(used) for one in priors])
        spectra = equations.solve(
            spectra, below, [one.right_hand_side(used) for one in priors], cg_steps
        )
        before, pictures = pictures, irfft2(spectra, observation.period_shape)
        equations.update_residual(pictures)
        for one, picture in zip(priors, pictures, strict=True):
            one.update(picture)
        if weight is None and number >= weight_delay:
            freedom = observation.explained_share(equations.mean_squared_residual)
            each = (
                one.gradients.estimate_weight(observation.disturbance, freedom) for one in priors
            )
            used = damped_weight(
                1 / sum(1 / w for w in each), used, first, max_weight_factor, 1 / max_weight_factor
            )
        change.append(
            relative_change(equations.visible_picture(pictures), equations.visible_picture(before))
        )
        if tol and change[-1] <= tol:
            ended = True
            break
    whole = equations.visible_picture(pictures)
    return RestoredImage(
        observation.crop_to_frame(whole).clamp(min=0),
        "depths" + (", hiding each other" if occlusion else ""),
        observation.noise,
        equations.mean_squared_residual**0.5,
        used,
        len(change),
        change,
        ended if tol else has_converged(change),
        whole,
    )


@single_threaded
@torch.no_grad()
def restore_layers_linearly(
    observation: LayeredObservation,
    weight: float | None = None,
    *,
    occlusion: bool = True,
    steps: int = 40,
) -> RestoredImage:
    """Restore a blurred photograph of several depth layers by linear deconvolution.

    The filter penalises the squared gradient, as wiener() does with "gradient", for PSFs that
    differ with depth. If `weight` is None, it is the one with the least predicted error.
    """
    penalty, used = penalty_of(observation, weight, "gradient", steps)
    equations = _LayerEquations(observation, occlusion)
    pictures = observation.extended_image.expand(equations.picture_count, *observation.period_shape)
    # Without this lower limit, nothing would determine the mean of a layer that the frame doesn't
    # show.
    below = penalty.clamp(min=1e-6 * used).expand(equations.picture_count, *penalty.shape)
    nothing = [None] * equations.picture_count
    spectra = equations.solve(rfft2(pictures), below, nothing, steps)
    pictures = irfft2(spectra, observation.period_shape)
    equations.update_residual(pictures)
    whole = equations.visible_picture(pictures)
    return RestoredImage(
        observation.crop_to_frame(whole), "depths, gradient", observation.noise,
        equations.mean_squared_residual**0.5, used, 1 + steps, period_image=whole,
    )  # fmt: skip


def paste_layers(
    observation: LayeredObservation, restore: Callable[[Observation], RestoredImage]
) -> torch.Tensor:
    """Deconvolve a photograph with each depth layer's PSF, and paste the layers' parts together.

    This is fast, but it is wrong where the blurred light of one layer covers another.
    """
    each = [restore(observation.as_single_layer(k)).image for k in range(len(observation.psfs))]
    return (torch.stack(each) * observation.shares).sum(0)


class _PicturePriors:
    """The priors of one picture in the restoration of depth layers."""

    def __init__(self, observation: LayeredObservation, power: float, positive: bool) -> None:
        dtype = observation.image.dtype
        self.gradients = TotalVariation(
            observation.period_shape, GRADIENT_THRESHOLD * observation.scale, power, dtype
        )
        bounded = positive or observation.border == "dark"
        bounds = (
            [NonNegativity(observation.period_shape, observation.support, dtype)] if bounded else []
        )
        self._all: list[Prior] = [self.gradients, *bounds]

    def denominator(self, weight: float) -> torch.Tensor:
        """Return the priors' part of the denominator in depth-layer deconvolution's picture step.

        The array has one value per frequency.
        """
        parts = [prior.coupling(weight, 1.0) * prior.gram_spectrum for prior in self._all]
        return sum(parts[1:], parts[0])

    def right_hand_side(self, weight: float) -> torch.Tensor | None:
        """Return the priors' part of the right-hand side in depth-layer deconvolution's step.

        The result is on pixels, or None if no prior has a part.
        """
        backs = [prior.adjoint_target * prior.coupling(weight, 1.0)
                 for prior in self._all if prior.adjoint_target is not None]  # fmt: skip
        return sum(backs[1:], backs[0]) if backs else None

    def update(self, picture: torch.Tensor) -> None:
        """Update the splits of all priors of depth-layer deconvolution for the next picture."""
        for prior in self._all:
            prior.update(picture)


class _LayerEquations:
    """The normal equations of the restoration of depth layers.

    They are (H* M H + K) x = H* M y + the priors' right-hand side, where M are the pixels' weights.
    x is one picture for each layer with occlusion, otherwise one picture.
    """

    def __init__(self, observation: LayeredObservation, occlusion: bool) -> None:
        self._observation, self._occlusion = observation, occlusion
        psfs = observation.psfs / observation.psf_sum
        self._blur: Operator = (OccludingBlur if occlusion else VaryingBlur)(
            psfs, observation.period_shares
        )
        self.picture_count = len(psfs) if occlusion else 1
        self._count = rfft_column_weights(observation.period_shape[1])
        self._mean_squared_mtf = observation.squared_mtf[None]
        if occlusion:
            self._mean_squared_mtf = squared_modulus(
                transfer_function(psfs, observation.period_shape)
            )
        self._weights = observation.effective_weights
        self._weighted_data = (
            observation.normalised_image
            if observation.effective_weights is None
            else observation.normalised_image * observation.effective_weights
        )
        self.mean_squared_residual = 1.0

    def visible_picture(self, pictures: torch.Tensor) -> torch.Tensor:
        """Compose the visible parts of all deconvolved depth layers to one period-wide picture."""
        return (
            (pictures * self._observation.period_shares).sum(0) if self._occlusion else pictures[0]
        )

    def solve(
        self,
        spectra: torch.Tensor,
        denominators: torch.Tensor,
        targets: Sequence[torch.Tensor | None],
        steps: int,
    ) -> torch.Tensor:
        """Solve the normal equations of depth-layer deconvolution for the spectra of x.

        Conjugate gradients start from `spectra`. `denominators` are K of each frequency of each
        picture, and `targets` are the priors' right-hand sides.
        """
        right = rfft2(self._blur_adjoint(self._weighted_data))
        for k, one in enumerate(targets):
            if one is not None:
                right[k] += rfft2(one)
        inverse = (self._mean_squared_mtf + denominators).clamp(min=1e-12).reciprocal_()

        def normal(x: torch.Tensor) -> torch.Tensor:
            light = self._observation.crop_to_frame(
                self._blur_pictures(irfft2(x, self._observation.period_shape))
            )
            kept = light if self._weights is None else light * self._weights
            return rfft2(self._blur_adjoint(kept)).add_(denominators * x)

        found, *_ = solve_on_frequencies(normal, right, spectra, inverse, self._count, steps)
        return found

    def update_residual(self, pictures: torch.Tensor) -> None:
        """Update depth-layer deconvolution's residual and the weights of clipped pixels.

        A clipped pixel has weight only where the blurred pictures are below the measured value.
        """
        seen, light = self._observation, self._blur_pictures(pictures)
        self.mean_squared_residual = seen.mean_squared_residual(light)
        if seen.clipped is None:
            return
        dim = (seen.clipped & (seen.crop_to_frame(light) < seen.normalised_image)).to(seen.image)
        weights = dim if seen.weights is None else dim * seen.weights
        self._weights = (
            weights if seen.effective_weights is None else seen.effective_weights + weights
        )
        self._weighted_data = seen.normalised_image * self._weights

    def _blur_pictures(self, pictures: torch.Tensor) -> torch.Tensor:
        """Blur the deconvolved depth layers' pictures to one photograph on the whole period."""
        light: torch.Tensor = self._blur(pictures if self._occlusion else pictures[0])
        return light

    def _blur_adjoint(self, frame: torch.Tensor) -> torch.Tensor:
        """Apply the adjoint of the blur of depth-layer deconvolution to light in the frame."""
        back: torch.Tensor = self._blur.adjoint(centred_pad(frame, self._observation.period_shape))
        return back if self._occlusion else back[None]
