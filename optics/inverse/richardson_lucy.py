"""The iteration of Richardson and Lucy (thesis Eq. 2.30), with an unknown border."""

from __future__ import annotations

import torch

from optics.fourier import irfft2, rfft2
from optics.inverse.blur import transfer_function
from optics.inverse.method import SETUP_COST, Gain, RestorationCost, RestorationMethod
from optics.inverse.observation import Observation
from optics.inverse.own_terms import in_own_unit
from optics.inverse.priors import gradient_adjoint, gradient_of
from optics.inverse.restored_image import RestoredImage, relative_change
from optics.plane import centred_pad
from optics.progress import Progress
from optics.threads import single_threaded
from optics.validation import require_count


@single_threaded
@in_own_unit(centred=True)
def richardson_lucy(
    observation: Observation,
    iterations: int = 30,
    *,
    accelerate: bool = True,
    total_variation: float = 0.0,
    tikhonov: float = 0.0,
    continue_past_noise: bool = False,
    progress: Progress | None = None,
) -> RestoredImage:
    """Deblur a photograph by the Richardson-Lucy iteration.

    The iteration converges towards the picture of greatest likelihood under photon noise, which is
    nowhere negative. Negative light, which the subtraction of dark frames leaves, counts as 0, and
    so do negative values of the PSF. Pixels that weren't measured, beyond the frame or in it, are
    restored with the others, and cause no ringing (Bertero and Boccacci 2005, doi
    10.1051/0004-6361:20052717).

    Raises ValueError for negative weights, or too few iterations.

    iterations: largest number of iterations.
    accelerate: whether each iteration starts from an extrapolation of the last two (Biggs and
        Andrews 1997, doi 10.1364/AO.36.001766), which replaces several iterations.
    total_variation: weight w of the regulariser in Eq. 2.30 of the thesis, whose factor is 1 / (1 -
        w Γ), with Γ = div(∇I / |∇I|) (Dey et al. 2006, doi 10.1002/jemt.20294).
    tikhonov: weight w of the same factor with Γ = ∇²I over the mean light.
    continue_past_noise: whether the iteration continues when the residual is no larger than the
        noise (Morozov 1966). It then turns noise into detail.
    """
    require_count("iterations", iterations)
    for name, value in (("total_variation", total_variation), ("tikhonov", tikhonov)):
        if not 0 <= value < float("inf"):
            raise ValueError(f"{name} is {value:g}; give 0 or more")
    progress = progress or Progress()
    likelihood = _Likelihood(observation)
    even = torch.full_like(likelihood.data, likelihood.mean_light)
    picture = even if observation.support is None else even * observation.support
    change, ended = list[float](), False
    direction, gains = torch.zeros(()), list[torch.Tensor]()
    for number in range(iterations):
        progress.report(number / iterations, f"Richardson-Lucy {number + 1}/{iterations}")
        ahead = picture
        if len(gains) == 2:
            before, last = (one.flatten() for one in gains)
            length = float(torch.dot(before, before))
            share = float(torch.dot(last, before)) / length if length > 0 else 0.0
            share = min(max(share, 0.0), 1.0)
            ahead = torch.add(picture, direction, alpha=share).clamp_(min=0)
        expected = likelihood.blur(ahead)
        if not continue_past_noise and observation.mean_squared_residual(expected) <= 1:
            ended = True
            break
        factor = _regulariser_factor(ahead, likelihood.mean_light, total_variation, tikhonov)
        fresh = likelihood.updated_picture(ahead, expected, factor)
        if accelerate:
            direction, gains = fresh - picture, [*gains[-1:], (fresh - ahead).detach()]
        change.append(relative_change(fresh, picture))
        picture = fresh
    name = "Richardson-Lucy" + (" with total variation" if total_variation else "")
    return RestoredImage(
        observation.crop_to_picture(picture).contiguous(),
        name,
        observation.noise,
        observation.mean_squared_residual(likelihood.blur(picture)) ** 0.5,
        None,
        len(change),
        change,
        ended,
        picture,
    )


class _Likelihood:
    """The Poisson likelihood of pictures on the whole period.

    data: the photograph, without negative light.
    mean_light: of the scene, above 0.
    """

    def __init__(self, observation: Observation) -> None:
        self._shape = shape = observation.period_shape
        self._transfer = transfer_function(
            observation.psf.clamp(min=0) / observation.psf_sum, shape
        )
        self._conjugate = self._transfer.conj().resolve_conj()
        data, trust = observation.normalised_image.clamp(min=0), observation.effective_weights
        trust = torch.ones_like(data) if trust is None else trust
        self._weights = centred_pad(trust, shape)
        reached = irfft2(rfft2(self._weights) * self._conjugate, shape)
        # A place that sends less than 1 % of the largest share of light into the frame can't be
        # restored, and isn't changed.
        least = 0.01 * float(reached.max())
        known = reached > least
        if observation.support is not None:
            known &= observation.support > 0
        self._step = torch.where(known, 1 / reached.clamp(min=least), 0.0)
        self._restorable = None if bool(known.all()) else known
        light = float((data.detach() * trust).sum() / trust.sum() / self._transfer[0, 0].real)
        self.mean_light = max(light, float(torch.finfo(data.dtype).tiny))
        self.data = centred_pad(data, shape)

    def blur(self, picture: torch.Tensor) -> torch.Tensor:
        """Blur a picture by the PSF, on the whole period."""
        return irfft2(rfft2(picture) * self._transfer, self._shape)

    def updated_picture(
        self, picture: torch.Tensor, expected: torch.Tensor, factor: torch.Tensor | None
    ) -> torch.Tensor:
        """Update a picture by one step (thesis Eq. 2.30).

        expected: the blurred picture.
        factor: the regulariser's factor, if there is one.
        """
        # The lower limit avoids a division by 0.
        ratio = self.data / expected.clamp(min=1e-6 * self.mean_light)
        ratio.mul_(self._weights)
        moved = irfft2(rfft2(ratio).mul_(self._conjugate), self._shape)
        moved.mul_(self._step).clamp_(min=0).mul_(picture)
        if factor is not None:
            moved.mul_(factor)
        return moved if self._restorable is None else torch.where(self._restorable, moved, picture)


def _regulariser_factor(
    picture: torch.Tensor, level: float, total_variation: float, tikhonov: float
) -> torch.Tensor | None:
    """Return the regulariser's factor 1 / (1 - w Γ), or None if there is none."""
    if not total_variation and not tikhonov:
        return None
    taken = torch.zeros_like(picture)
    if total_variation:
        # div(∇I / |∇I|), where |∇I|² + (a thousandth of the mean light)² avoids a division by 0.
        down, along = gradient_of(picture)
        length = torch.addcmul(down * down, along, along).add_((1e-3 * level) ** 2).rsqrt_()
        direction = down.mul_(length), along.mul_(length)
        taken.add_(gradient_adjoint(direction, length).neg_(), alpha=total_variation)
    if tikhonov:
        laplacian = gradient_adjoint(gradient_of(picture), torch.empty_like(picture)).neg_()
        taken.add_(laplacian, alpha=tikhonov / level)
    # The limit of 0.9 keeps the factor positive.
    return taken.clamp_(max=0.9).neg_().add_(1).reciprocal_()


def _solve(
    observation: Observation, weight: float | None, *, iterations: int, progress: Progress
) -> RestoredImage:
    return richardson_lucy(
        observation, iterations, total_variation=weight or 0.0, progress=progress
    )


METHOD = RestorationMethod(
    "likeliest under photon noise (Eq. 2.30), accelerated; stops at the noise",
    _solve, {
        10: Gain(3.51, -0.01, 0.37, 0.71, 0.03, -0.23),
        20: Gain(4.40, -0.33, 0.30, 1.24, -0.36, -0.55),
        30: Gain(4.65, -0.49, 0.22, 1.46, -0.56, -0.68),
    }, 30, SETUP_COST, lambda _: RestorationCost(4, 60),
)  # fmt: skip
