"""Deconvolution with a hyper-Laplacian prior, which suits the gradients of natural pictures."""

from __future__ import annotations

import math

import torch

from optics.deconvolution.method import SETUP_COST, RestorationCost, RestorationMethod
from optics.deconvolution.normal_equations import NormalEquations, least_weight
from optics.deconvolution.observation import Observation
from optics.deconvolution.priors import (
    LEAST_WEIGHT_SHARE,
    add_gradient,
    gradient_adjoint,
    laplacian_spectrum,
    mean_gradient,
    weight_by_evidence,
)
from optics.deconvolution.restoration_case import Gain
from optics.deconvolution.restored_image import CONVERGED_CHANGE, RestoredImage, relative_change
from optics.deconvolution.shrinkage import require_power, shrinkage_factor
from optics.deconvolution.total_variation import initial_weight
from optics.fourier import rfft2
from optics.progress import Progress
from optics.threads import single_threaded
from optics.validation import require_positive

_STEPS = 3
"""Steps of conjugate gradients in a round, which starts from the last one's picture."""


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
    """Restore a blurred photograph with a hyper-Laplacian prior, the sum of gradients to a power.

    The result minimises |H x - y|² / 2 + weight * the sum of |∇x|^power, where the first term
    counts trusted pixels only (Krishnan and Fergus 2009, "Fast image deconvolution using
    hyper-Laplacian priors", NIPS 22). |∇x| is the length of the gradient, independent of its
    direction.

    The solver is half-quadratic splitting. In turn, it shrinks the split gradients one by one, and
    computes the picture that is nearest to them and to the data, while their coupling grows. The
    problem has many minima. The solver ends near a good one, and more rounds lead to a lower one.

    Parameters
    ----------
    observation : Observation
        Photograph and PSF.
    power : float, optional
        Power of the gradients' lengths, above 0 and up to 1. It is 0.5 to 0.8 for natural pictures.
    weight : float, optional
        Regularisation weight, in light per pixel to the power 2 - power. Estimated from the
        evidence of the picture if None.
    rounds : int, optional
        Number of couplings, spaced evenly in logarithms, 2 or more. Each round costs one pair of
        FFTs if the whole period was measured, otherwise a few pairs.
    progress : Progress, optional
        Receives reports, and can cancel the work.

    Returns
    -------
    RestoredImage
        The picture in the photograph's frame, never negative.

    Raises
    ------
    ValueError
        For a power outside 0 to 1, a weight that isn't positive, or too few rounds.
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
    first = initial_weight(observation, power) if weight is None else weight
    used = first
    for number, coupling in enumerate(_couplings(observation.scale, power, rounds)):
        progress.report(number / rounds, f"hyper-Laplacian {number + 1}/{rounds}")
        least = least_weight(observation, _low_frequency_laplacian, _STEPS * (number + 1))
        coupling = max(coupling, least / used)
        near = _fit_shrunk_gradient(picture, power, coupling, square)
        spectrum, *_ = equations.solve(square * (used * coupling), spectrum, _STEPS, near)
        before, picture = picture, equations.picture(spectrum)
        if observation.support is not None:
            picture.mul_(observation.support)
        change.append(relative_change(picture, before))
        if weight is None:
            wanted = _estimate_weight(observation, picture, power, equations.residual(spectrum))
            # Without a limit, noise that became detail would ask for less and less weight.
            used = max(wanted, LEAST_WEIGHT_SHARE * first)
    return RestoredImage(
        observation.crop_to_frame(picture).clamp(min=0),
        f"hyper-Laplacian, power {power:.3g}",
        observation.noise,
        equations.residual(spectrum),
        used,
        rounds,
        change,
        # The last round's coupling is the one whose solution is wanted.
        change[-1] <= CONVERGED_CHANGE,
        picture,
    )


def _low_frequency_laplacian(squares: torch.Tensor) -> torch.Tensor:
    """Return the negative Laplacian at low squared frequencies, for a deconvolution's coupling."""
    return 4 * math.pi**2 * squares


def _couplings(scale: float, power: float, rounds: int) -> list[float]:
    """Return the couplings of hyper-Laplacian deconvolution's split gradient, from loose to tight.

    For pictures of unit scale they go from 1 to 1000.
    """
    ways = torch.logspace(0, 1, rounds, base=1e3, dtype=torch.float64)
    return (ways / scale ** (2 - power)).tolist()


def _fit_shrunk_gradient(
    picture: torch.Tensor, power: float, coupling: float, square: torch.Tensor
) -> torch.Tensor:
    """Return the spectrum of the deconvolved picture whose gradient is nearest to a shrunk one."""
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
    """Estimate the weight of deconvolution's hyper-Laplacian prior from the restored picture.

    See weight_by_evidence().
    """
    freedom = observation.explained_share(residual**2)
    return weight_by_evidence(
        mean_gradient(picture, power), power, observation.disturbance, freedom
    )


def _solve(
    observation: Observation, weight: float | None, *, iterations: int, progress: Progress
) -> RestoredImage:
    """Run hyper-Laplacian deconvolution through the interface of all restorations."""
    return hyper_laplacian(observation, weight=weight, rounds=iterations, progress=progress)


def _round_cost(observation: Observation) -> RestorationCost:
    """Return the cost of one round of hyper-Laplacian deconvolution."""
    return RestorationCost(2, 60) if observation.is_fully_measured else RestorationCost(14, 200)


METHOD = RestorationMethod(
    "gradients with the heavy tails of natural pictures",
    _solve, {
        5: Gain(7.38, -0.60, 0.61, 1.30, 0.24, -1.21),
        10: Gain(8.17, -0.81, 0.84, 1.21, 0.44, -0.96),
    }, 10, SETUP_COST, _round_cost,
)  # fmt: skip
