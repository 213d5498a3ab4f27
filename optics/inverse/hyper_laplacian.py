"""Deblur with a hyper-Laplacian prior, which suits the gradients of natural pictures."""

from __future__ import annotations

import math

import torch

from optics.inverse.method import SETUP_COST, Gain, RestorationCost, RestorationMethod
from optics.inverse.normal_equations import ConjugateGradientStep, NormalEquations, least_weight
from optics.inverse.observation import Observation
from optics.inverse.own_terms import in_own_unit, with_centred_psf
from optics.inverse.priors import (
    LEAST_WEIGHT_SHARE,
    Prior,
    add_gradient,
    gradient_adjoint,
    laplacian_spectrum,
    mean_gradient,
    weight_by_evidence,
)
from optics.inverse.restored_image import CONVERGED_CHANGE, RestoredImage
from optics.inverse.splitting import SplittingSettings, restored_image, solve_by_splitting
from optics.inverse.total_variation import (
    initial_weight,
    light_in_weight,
    require_power,
    shrinkage_factor,
)
from optics.progress import Progress
from optics.threads import single_threaded
from optics.validation import require_positive

_STEPS = 3
"""Steps of conjugate gradients in a round, which starts from the last one's picture."""


@single_threaded
@torch.no_grad()
@in_own_unit(weight=light_in_weight)
@with_centred_psf
def hyper_laplacian(
    observation: Observation,
    power: float = 2 / 3,
    weight: float | None = None,
    *,
    rounds: int = 10,
    progress: Progress | None = None,
) -> RestoredImage:
    """Deblur with a hyper-Laplacian prior, the sum of the gradients' lengths to a power.

    The result minimises |H x - y|² / 2 + weight * the sum of |∇x|^power, where the first term
    counts trusted pixels only (Krishnan and Fergus 2009, "Fast image deconvolution using
    hyper-Laplacian priors", NIPS 22). |∇x| is the length of the gradient, independent of its
    direction. The picture is cut to be nowhere negative.

    The solver is half-quadratic splitting. In turn, it shrinks the split gradients one by one, and
    computes the picture that is nearest to them and to the data, while their coupling grows. The
    problem has many minima. The solver ends near a good one, and more rounds lead to a lower one.

    Raises ValueError for a power outside 0 to 1, a weight that isn't positive, or too few rounds.

    power: power of the gradients' lengths, above 0 and up to 1. It is 0.5 to 0.8 for natural
        pictures.
    weight: regularisation weight, in light per pixel to the power 2 - power. Estimated from the
        evidence of the picture if None.
    rounds: number of couplings, spaced evenly in logarithms, 2 or more. Each round costs one pair
        of FFTs if the whole period was measured, otherwise a few pairs.
    """
    require_power(power)
    if weight is not None:
        require_positive("weight", weight, "")
    if rounds < 2:
        raise ValueError(f"rounds is {rounds}; at least 2 are needed, a loose and a tight one")
    name = f"hyper-Laplacian, power {power:.3g}"
    first = initial_weight(observation, power) if weight is None else weight

    def estimate(picture: torch.Tensor, used: float, residual: float) -> float:
        freedom = observation.explained_share(residual)
        mean = mean_gradient(picture[0], power)
        wanted = weight_by_evidence(mean, power, observation.disturbance, freedom)
        # Without a limit, noise that became detail would ask for less and less weight.
        return max(wanted, LEAST_WEIGHT_SHARE * first)

    settings = SplittingSettings(
        rounds, first, estimate if weight is None else None, starts_from_picture=True
    )
    step = ConjugateGradientStep(NormalEquations(observation, keeps_mean=True), _STEPS)
    prior = _ShrunkGradient(observation, power, rounds)
    solution = solve_by_splitting(step, [prior], settings, name, progress or Progress())
    # The last round's coupling is the one whose solution is wanted.
    converged = solution.relative_changes[-1] <= CONVERGED_CHANGE
    return restored_image(step, solution, name, converged)


class _ShrunkGradient(Prior):
    """The split gradient, with a coupling that grows from round to round."""

    def __init__(self, observation: Observation, power: float, rounds: int) -> None:
        self._observation, self._power, self._round = observation, power, 0
        self._couplings = _couplings(observation.scale, power, rounds)
        shape = observation.period_shape
        self.gram_spectrum = laplacian_spectrum(shape).to(observation.squared_mtf)

    def coupling(self, weight: float, data: float) -> float:
        return weight * self._coupling

    def update(self, x: torch.Tensor, weight: float) -> None:
        seen = self._observation
        x = x if seen.support is None else x * seen.support
        least = least_weight(seen, _low_frequency_laplacian, _STEPS * (self._round + 1))
        self._coupling = max(self._couplings[self._round], least / weight)
        self._round += 1
        down, along = torch.zeros_like(x), torch.zeros_like(x)
        add_gradient(x, down, along)
        squares = torch.addcmul(down * down, along, along)
        share = shrinkage_factor(squares, self._power, self._coupling)
        self.adjoint_target = gradient_adjoint(down.mul_(share), along.mul_(share), share)


def _low_frequency_laplacian(squares: torch.Tensor) -> torch.Tensor:
    """Return the negative Laplacian at low frequencies, by their squares in (cycles/pixel)²."""
    return 4 * math.pi**2 * squares


def _couplings(scale: float, power: float, rounds: int) -> list[float]:
    """Return the couplings of the split gradient, from loose to tight.

    For pictures of unit scale they go from 1 to 1000.
    """
    ways = torch.logspace(0, 1, rounds, base=1e3, dtype=torch.float64)
    return (ways / scale ** (2 - power)).tolist()


def _solve(
    observation: Observation, weight: float | None, *, iterations: int, progress: Progress
) -> RestoredImage:
    return hyper_laplacian(observation, weight=weight, rounds=iterations, progress=progress)


def _round_cost(observation: Observation) -> RestorationCost:
    return RestorationCost(2, 60) if observation.is_fully_measured else RestorationCost(14, 200)


METHOD = RestorationMethod(
    "gradients with the heavy tails of natural pictures",
    _solve, {
        5: Gain(7.38, -0.60, 0.61, 1.30, 0.24, -1.21),
        10: Gain(8.17, -0.81, 0.84, 1.21, 0.44, -0.96),
    }, 10, SETUP_COST, _round_cost,
)  # fmt: skip
