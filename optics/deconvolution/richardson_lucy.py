"""Richardson-Lucy deconvolution (thesis Eq. 2.30), with an unknown border."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from optics.deconvolution.method import SETUP_COST, RestorationCost, RestorationMethod
from optics.deconvolution.observation import Observation
from optics.deconvolution.priors import divergence_of_direction, laplacian_of
from optics.deconvolution.restored_image import RestoredImage, relative_change
from optics.fourier import irfft2, rfft2
from optics.operators.blur import transfer_function
from optics.plane import centred_pad
from optics.progress import Progress
from optics.threads import single_threaded
from optics.validation import require_count

_FLOOR = 1e-6
"""Of the mean light: less isn't divided by."""

_MIN_SENSITIVITY = 0.01
"""Share of the best-seen place's light that gets into the frame, below which a place is left be."""

_MAX_REGULARISATION = 0.9
"""Of what a regulariser may take or give in one iteration: its factor stays positive."""


@single_threaded
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
    """The picture under which the photons that were counted are the likeliest, (rows, columns).

    Negative light, which dark subtraction leaves, counts as none, and so do negative values of the
    PSF. What wasn't measured, beyond the frame or in it, is restored with the rest (Bertero and
    Boccacci 2005, doi 10.1051/0004-6361:20052717), so that it leaves no rings.

    accelerate: whether each iteration starts from where the last two lead (Biggs and Andrews
    1997, doi 10.1364/AO.36.001766), which does the work of several. total_variation, tikhonov:
    weights w of Eq. 2.30's regulariser, whose factor 1 / (1 - w Γ) has Γ = div(∇I / |∇I|) (Dey et
    al. 2006, doi 10.1002/jemt.20294) and Γ = ∇²I over the mean light. continue_past_noise: whether
    it goes on where no more is left unexplained than noise, which it would make detail of (Morozov
    1966). Raises ValueError for weights that are negative, or too few iterations.
    """
    require_count("iterations", iterations)
    for name, value in (("total_variation", total_variation), ("tikhonov", tikhonov)):
        if not 0 <= value < float("inf"):
            raise ValueError(f"{name} is {value:g}; give 0 or more")
    progress = progress or Progress()
    likelihood = _Likelihood.of(observation)
    path = _Iterates(likelihood.initial_picture(), accelerate)
    change, ended = list[float](), False
    for number in range(iterations):
        progress.report(number / iterations, f"Richardson-Lucy {number + 1}/{iterations}")
        ahead = path.extrapolate()
        expected = likelihood.blur(ahead)
        if not continue_past_noise and observation.mean_squared_residual(expected) <= 1:
            ended = True
            break
        factor = _regulariser_factor(ahead, likelihood.mean_light, total_variation, tikhonov)
        change.append(path.advance(likelihood.updated_picture(ahead, expected, factor), ahead))
    picture = path.current
    name = "Richardson-Lucy" + (" with total variation" if total_variation else "")
    return RestoredImage(
        observation.crop_to_frame(picture).contiguous(),
        name,
        observation.noise,
        observation.mean_squared_residual(likelihood.blur(picture)) ** 0.5,
        None,
        len(change),
        change,
        ended,
    )


@dataclass(frozen=True, eq=False)
class _Likelihood:
    """Of pictures on the whole period: Poisson's, of the pixels that are trusted."""

    observation: Observation
    otf: torch.Tensor
    conjugate_otf: torch.Tensor
    data: torch.Tensor
    period_weights: torch.Tensor
    inverse_sensitivity: torch.Tensor
    restorable: torch.Tensor | None
    mean_light: float

    @classmethod
    def of(cls, observation: Observation) -> _Likelihood:
        psf = observation.psf.clamp(min=0) / observation.psf_sum
        transfer = transfer_function(psf, observation.period_shape)
        data = observation.normalised_image.clamp(min=0)
        trust = (
            torch.ones_like(data)
            if observation.effective_weights is None
            else observation.effective_weights
        )
        measured = centred_pad(trust, observation.period_shape)
        back = transfer.conj().resolve_conj()
        reached = irfft2(rfft2(measured) * back, observation.period_shape)
        least = _MIN_SENSITIVITY * float(reached.max())
        # Where almost no light comes from into the picture, nothing is known: leave it be.
        known = reached > least
        if observation.support is not None:
            known &= observation.support > 0
        step = torch.where(known, 1 / reached.clamp(min=least), 0.0)
        light = float((data.detach() * trust).sum() / trust.sum() / transfer[0, 0].real)
        level = max(light, float(torch.finfo(data.dtype).tiny))
        data = centred_pad(data, observation.period_shape)
        everywhere = bool(known.all())
        return cls(
            observation, transfer, back, data, measured, step, None if everywhere else known, level
        )

    def initial_picture(self) -> torch.Tensor:
        """Even light; none where nothing shines."""
        even = torch.full_like(self.data, self.mean_light)
        return even if self.observation.support is None else even * self.observation.support

    def blur(self, picture: torch.Tensor) -> torch.Tensor:
        return irfft2(rfft2(picture) * self.otf, self.observation.period_shape)

    def updated_picture(
        self, picture: torch.Tensor, expected: torch.Tensor, factor: torch.Tensor | None
    ) -> torch.Tensor:
        """Eq. 2.30. expected: the picture as it falls on the sensor."""
        ratio = self.data / expected.clamp(min=_FLOOR * self.mean_light)
        ratio.mul_(self.period_weights)
        moved = irfft2(rfft2(ratio).mul_(self.conjugate_otf), self.observation.period_shape)
        moved.mul_(self.inverse_sensitivity).clamp_(min=0).mul_(picture)
        if factor is not None:
            moved.mul_(factor)
        return moved if self.restorable is None else torch.where(self.restorable, moved, picture)


class _Iterates:
    """Pictures one after the other, and where the last two lead."""

    def __init__(self, start: torch.Tensor, accelerate: bool) -> None:
        self.current, self._accelerate = start, accelerate
        self._direction: torch.Tensor | None = None
        self._gains: list[torch.Tensor] = []

    def extrapolate(self) -> torch.Tensor:
        """Where the next iteration starts."""
        if not self._accelerate or self._direction is None or len(self._gains) < 2:
            return self.current
        before, last = self._gains
        length = float(torch.dot(before.flatten(), before.flatten()))
        share = float(torch.dot(last.flatten(), before.flatten())) / length if length > 0 else 0.0
        share = min(max(share, 0.0), 1.0)
        return torch.add(self.current, self._direction, alpha=share).clamp_(min=0)

    def advance(self, fresh: torch.Tensor, ahead: torch.Tensor) -> float:
        """The next picture; how much it changes, relative."""
        self._direction = fresh - self.current
        if self._accelerate:
            self._gains = [*self._gains[-1:], (fresh - ahead).detach()]
        before, self.current = self.current, fresh
        return relative_change(fresh, before)


def _regulariser_factor(
    picture: torch.Tensor, level: float, total_variation: float, tikhonov: float
) -> torch.Tensor | None:
    """1 / (1 - w Γ)."""
    if not total_variation and not tikhonov:
        return None
    taken = torch.zeros_like(picture)
    if total_variation:
        taken.add_(divergence_of_direction(picture, 1e-3 * level), alpha=total_variation)
    if tikhonov:
        taken.add_(laplacian_of(picture), alpha=tikhonov / level)
    return taken.clamp_(max=_MAX_REGULARISATION).neg_().add_(1).reciprocal_()


def _solve(
    observation: Observation, weight: float | None, *, iterations: int, progress: Progress
) -> RestoredImage:
    return richardson_lucy(
        observation, iterations, total_variation=weight or 0.0, progress=progress
    )


METHOD = RestorationMethod(
    "likeliest under photon noise (Eq. 2.30), accelerated; stops at the noise",
    _solve, {10: 2.3, 20: 2.5, 30: 2.5}, 30, SETUP_COST, lambda _: RestorationCost(4, 60),
)  # fmt: skip
