"""Deconvolution by the heavy tails of natural pictures' gradients: a few closed forms in turn."""

from __future__ import annotations

import torch

from optics.deconvolution.method import SETUP_COST, RestorationCost, RestorationMethod
from optics.deconvolution.normal_equations import NormalEquations
from optics.deconvolution.observation import Observation
from optics.deconvolution.priors import (
    add_gradient,
    gradient_adjoint,
    laplacian_spectrum,
    mean_gradient,
    weight_by_evidence,
)
from optics.deconvolution.restored_image import RestoredImage, relative_change
from optics.deconvolution.shrinkage import require_power, shrinkage_factor
from optics.deconvolution.splitting import MIN_EXPLAINED_SHARE
from optics.deconvolution.total_variation import initial_weight
from optics.fourier import rfft2
from optics.progress import Progress
from optics.threads import single_threaded
from optics.validation import require_positive

_FIRST_COUPLING, _LAST_COUPLING = 1.0, 1e3
"""Couplings of the split gradient, first and last, for pictures of unit scale and steps."""

_STEPS = 3
"""Of conjugate gradients, in each round: each starts where the last one ended."""


@single_threaded
@torch.no_grad()
def hyper_laplacian(
    observation: Observation,
    power: float = 2 / 3,
    weight: float | None = None,
    *,
    rounds: int = 10,
    progress: Progress | None = None,
) -> RestoredImage:
    """The photograph with its blur undone: the least of |H x - y|² / 2, trusted pixels alone,
    + weight * the sum of |∇x|^power (Krishnan and Fergus 2009, "Fast image deconvolution using
    hyper-Laplacian priors", NIPS 22).

    Half-quadratic splitting: gradients that are split off, each shrunk by itself, and the picture
    that is nearest to them and to the data, in turn, while their coupling grows. Lengths of
    gradients count in all directions alike. The problem has many minima: it ends near a good one,
    and more rounds lead to a lower one.

    power: above 0 to 1; 1/2 to 0.8 are natural pictures'. weight: light per pixel to the power
    2 - power; by the evidence of the picture if None. rounds: couplings, evenly spaced in
    logarithms; each costs an FFT pair on a period seen whole, else a few.
    Raises ValueError for a power outside 0 to 1, a weight that isn't positive, or too few rounds.
    """
    require_power(power)
    if weight is not None:
        require_positive("weight", weight, "")
    if rounds < 2:
        raise ValueError(f"rounds is {rounds}; at least 2 are needed, a loose and a tight one")
    progress = progress or Progress()
    equations = NormalEquations(observation)
    square = laplacian_spectrum(observation.period_shape).to(observation.squared_mtf)
    picture, change = observation.extended_image, list[float]()
    spectrum = rfft2(picture - equations.mean)
    used = initial_weight(observation, power) if weight is None else weight
    for number, coupling in enumerate(_couplings(observation.scale, power, rounds)):
        progress.report(number / rounds, f"hyper-Laplacian {number + 1}/{rounds}")
        near = _fit_shrunk_gradient(picture, power, coupling, square)
        spectrum, _ = equations.solve(square * (used * coupling), spectrum, _STEPS, near)
        before, picture = picture, equations.picture(spectrum)
        if observation.support is not None:
            picture.mul_(observation.support)
        change.append(relative_change(picture, before))
        if weight is None:
            used = _estimate_weight(observation, picture, power, equations.residual(spectrum))
    return RestoredImage(
        observation.crop_to_frame(picture).clamp(min=0),
        f"hyper-Laplacian, power {power:.3g}",
        observation.noise,
        equations.residual(spectrum),
        used,
        rounds,
        change,
        period_image=picture,
    )


def _couplings(scale: float, power: float, rounds: int) -> list[float]:
    ways = torch.logspace(0, 1, rounds, base=_LAST_COUPLING / _FIRST_COUPLING, dtype=torch.float64)
    return (ways * _FIRST_COUPLING / scale ** (2 - power)).tolist()


def _fit_shrunk_gradient(
    picture: torch.Tensor, power: float, coupling: float, square: torch.Tensor
) -> torch.Tensor:
    """Spectrum of the picture whose gradient is nearest to the shrunk one of this."""
    down, along = torch.zeros_like(picture), torch.zeros_like(picture)
    add_gradient(picture, down, along)
    share = shrinkage_factor(torch.addcmul(down * down, along, along), power, coupling)
    wanted = rfft2(gradient_adjoint(down.mul_(share), along.mul_(share), share))
    wanted.div_(square.clamp(min=1e-12))
    wanted[0, 0] = 0
    return wanted


def _estimate_weight(
    observation: Observation, picture: torch.Tensor, power: float, residual: float
) -> float:
    """The weight by the evidence of this picture."""
    freedom = max(1 - residual**2, MIN_EXPLAINED_SHARE)
    return weight_by_evidence(
        mean_gradient(picture, power), power, observation.scene_noise, freedom
    )


def _solve(
    observation: Observation, weight: float | None, *, iterations: int, progress: Progress
) -> RestoredImage:
    return hyper_laplacian(observation, weight=weight, rounds=iterations, progress=progress)


def _round_cost(observation: Observation) -> RestorationCost:
    return RestorationCost(2, 60) if observation.is_fully_measured else RestorationCost(14, 200)


METHOD = RestorationMethod(
    "gradients with the heavy tails of natural pictures",
    _solve, {5: 3.0, 10: 4.3}, 10, SETUP_COST, _round_cost,
)  # fmt: skip
