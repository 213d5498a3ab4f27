"""Restoration of a photograph of several depths, all of them together."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch

from optics.deconvolution.layered_observation import LayeredObservation
from optics.deconvolution.noise import squared_modulus
from optics.deconvolution.normal_equations import solve_on_frequencies
from optics.deconvolution.observation import Observation
from optics.deconvolution.priors import NonNegativity, Prior, TotalVariation
from optics.deconvolution.restored_image import RestoredImage, relative_change
from optics.deconvolution.shrinkage import require_power
from optics.deconvolution.splitting import MIN_EXPLAINED_SHARE, damped_weight
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

_WEIGHT_DELAY, _MAX_WEIGHT_FACTOR = 3, 8.0
"""Iterations after which a weight that is looked for moves, and how far it may, as a factor: the
spectrum of several depths tells little about where it begins."""


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
    """The scene of least |H X - O|² / 2, trusted pixels alone, + weight * gradients' lengths to a
    power, with the PSF of each depth where that depth is (thesis Fig. 2.17).

    weight, power, positive, tol: as for total_variation(). occlusion: whether nearer layers, the
    first ones, hide the farther ones, as things do; then each layer is looked for behind what hides
    it as well, and the picture is put together of what is seen. cg_steps: steps of conjugate
    gradients in each iteration.

    By the alternating direction method of multipliers with gradients split off (Boyd et al. 2011,
    doi 10.1561/2200000016). The picture's step has no closed form where PSFs differ; it is solved
    from the last one on by conjugate gradients, preconditioned by the layers' mean power. What was
    clipped counts where the picture has less light there than was measured.

    Not modelled: depth beyond the frame, where the layers of its edge go on; layers that aren't
    where the map says; and what OccludingBlur leaves out.
    Raises ValueError for a weight that isn't positive, a power outside 0 to 1, or no iteration.
    """
    if weight is not None:
        require_positive("weight", weight, "")
    require_power(power)
    require_count("iterations", iterations)
    require_count("cg_steps", cg_steps)
    progress, equations = progress or Progress(), _LayerEquations(observation, occlusion)
    priors = [_PicturePriors(observation, power, positive) for _ in range(equations.picture_count)]
    first = initial_weight(observation, power)
    used, change, converged = first if weight is None else weight, list[float](), tol == 0
    pictures = observation.extended_image.expand(
        equations.picture_count, *observation.period_shape
    ).clone()
    spectra = rfft2(pictures)
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
        if weight is None and number >= _WEIGHT_DELAY:
            freedom = max(1 - equations.mean_squared_residual, MIN_EXPLAINED_SHARE)
            each = (
                one.gradients.estimate_weight(observation.scene_noise, freedom) for one in priors
            )
            used = damped_weight(1 / sum(1 / w for w in each), used, first, _MAX_WEIGHT_FACTOR)
        change.append(
            relative_change(equations.visible_picture(pictures), equations.visible_picture(before))
        )
        if tol and change[-1] <= tol:
            converged = True
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
        converged,
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
    """The same with a weight on the gradient's square: wiener()'s "gradient", linear, for a PSF
    that differs with depth. weight: the one with the least predicted error if None."""
    penalty, used = penalty_of(observation, weight, "gradient")
    equations = _LayerEquations(observation, occlusion)
    pictures = observation.extended_image.expand(equations.picture_count, *observation.period_shape)
    # A layer that the frame doesn't show, and where nothing is known of it, is as bright as others.
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
    """Of restorations of all of the photograph with each layer's PSF, what is that layer: quick,
    but wrong where a layer's light has spread over another."""
    each = [restore(observation.as_single_layer(k)).image for k in range(len(observation.psfs))]
    return (torch.stack(each) * observation.shares).sum(0)


class _PicturePriors:
    """Of one picture."""

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
        parts = [prior.coupling(weight, 1.0) * prior.gram_spectrum for prior in self._all]
        return sum(parts[1:], parts[0])

    def right_hand_side(self, weight: float) -> torch.Tensor | None:
        backs = [prior.adjoint_target * prior.coupling(weight, 1.0)
                 for prior in self._all if prior.adjoint_target is not None]  # fmt: skip
        return sum(backs[1:], backs[0]) if backs else None

    def update(self, picture: torch.Tensor) -> None:
        for prior in self._all:
            prior.update(picture)


class _LayerEquations:
    """(H* M H + K) x = H* M y + what priors want, of one picture or one for each layer."""

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
        """Of all layers what is seen, on the whole period."""
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
        """Spectra of x, from those that are given. denominators: K of each frequency of each
        picture."""
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

        found, _ = solve_on_frequencies(normal, right, spectra, inverse, self._count, steps)
        return found

    def update_residual(self, pictures: torch.Tensor) -> None:
        """What they leave unexplained, and which clipped pixels have too little light."""
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
        light: torch.Tensor = self._blur(pictures if self._occlusion else pictures[0])
        return light

    def _blur_adjoint(self, frame: torch.Tensor) -> torch.Tensor:
        back: torch.Tensor = self._blur.adjoint(centred_pad(frame, self._observation.period_shape))
        return back if self._occlusion else back[None]
