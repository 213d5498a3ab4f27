"""Deblur with a hyper-Laplacian prior, which suits the gradients of natural pictures."""

from __future__ import annotations

import math
from functools import lru_cache

import torch

from optics.inverse.method import SETUP_COST, Gain, RestorationCost, RestorationMethod
from optics.inverse.normal_equations import ConjugateGradientStep, NormalEquations, least_weight
from optics.inverse.observation import Observation
from optics.inverse.own_terms import in_own_unit
from optics.inverse.priors import (
    LEAST_WEIGHT_SHARE,
    Prior,
    gradient_adjoint,
    gradient_of,
    laplacian_spectrum,
    mean_gradient,
    weight_by_evidence,
)
from optics.inverse.restored_image import CONVERGED_CHANGE, RestoredImage
from optics.inverse.splitting import SplittingSettings, restored_image, solve_by_splitting
from optics.inverse.total_variation import initial_weight, light_in_weight, require_power
from optics.progress import Progress
from optics.threads import single_threaded
from optics.validation import require_positive

# Entries of the table; linear interpolation between them is accurate to 1e-6 of the length.
_ENTRIES = 2048

_STEPS = 3  # steps of conjugate gradients in a round, which starts from the last one's picture


@single_threaded
@torch.no_grad()
@in_own_unit(weight=light_in_weight, centred=True)
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

    Half-quadratic splitting shrinks the split gradients one by one, and computes the picture that
    is nearest to them and to the data, in turn, while their coupling grows. It ends near a good one
    of many minima; more rounds lead to a lower one.

    Raises ValueError for a power outside 0 to 1, a weight that isn't positive, or too few rounds.

    power: power of the gradients' lengths, above 0 and up to 1. It is 0.5 to 0.8 for natural
        pictures.
    weight: regularisation weight, in light per pixel to the power 2 - power. Estimated from the
        evidence of the picture if None.
    rounds: number of couplings, spaced evenly in logarithms, 2 or more.
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
        # For pictures of unit scale, the couplings go from 1, which is loose, to 1000.
        ways = torch.logspace(0, 1, rounds, base=1e3, dtype=torch.float64)
        self._couplings = (ways / observation.scale ** (2 - power)).tolist()
        shape = observation.period_shape
        self.gram_spectrum = laplacian_spectrum(shape).to(observation.squared_mtf)

    def coupling(self, weight: float, data: float) -> float:
        return weight * self._coupling

    def update(self, x: torch.Tensor, weight: float) -> None:
        seen = self._observation
        x = x if seen.support is None else x * seen.support
        # The Laplacian at low frequencies is (2 π f)².
        steps = _STEPS * (self._round + 1)
        least = least_weight(seen, lambda squares: 4 * math.pi**2 * squares, steps)
        self._coupling = max(self._couplings[self._round], least / weight)
        self._round += 1
        down, along = gradient_of(x)
        squares = torch.addcmul(down * down, along, along)
        share = shrinkage_factor(squares, self._power, self._coupling)
        self.adjoint_target = gradient_adjoint((down.mul_(share), along.mul_(share)), share)


def shrinkage_factor(squares: torch.Tensor, power: float, coupling: float) -> torch.Tensor:
    """Return the share of a gradient w that is kept: |v| / |w| of the best v.

    v minimises |v|^power + coupling / 2 (v - w)². It is 0 up to a threshold of |w|. Beyond it, |v|
    is the largest root of |v| - |w| = -(power / coupling) |v|^(power - 1) (Krishnan and Fergus
    2009). The result is accurate to 1e-6.

    squares: |w|² of each gradient.
    """
    threshold, table = _shrinkage_table(power)
    table = table.to(squares)
    place = (squares + torch.finfo(squares.dtype).tiny).rsqrt_()
    place.mul_(threshold * coupling ** (-1 / (2 - power)) * _ENTRIES)
    lost = place > _ENTRIES
    # The table is indexed by the inverse length: infinity is at 0, and the threshold at the end.
    below = place.clamp_(max=_ENTRIES).long().clamp_(max=_ENTRIES - 1)
    share = torch.lerp(table[below], table[below + 1], place - below)
    return share.masked_fill_(lost, 0.0)


@lru_cache
def _shrinkage_table(power: float) -> tuple[float, torch.Tensor]:
    """Compute the shrinkage threshold for a coupling of 1, and a table of the shares kept.

    Entry i is the share that is kept of a gradient of length threshold / (i / _ENTRIES).
    """
    least = (2 * (1 - power)) ** (1 / (2 - power))
    threshold = least + power * least ** (power - 1) if power < 1 else 1.0
    part = torch.arange(1, _ENTRIES + 1, dtype=torch.float64) / _ENTRIES
    length = threshold / part
    root = length.clone()
    # Newton's method needs many steps: at the threshold, each step only halves the error.
    for _ in range(60):
        slope = 1 - power * (1 - power) * root ** (power - 2)
        root = root - (root - length + power * root ** (power - 1)) / slope
        root = root.clamp(min=max(least, 1e-12))
    return threshold, torch.cat([torch.ones(1, dtype=torch.float64), root / length])


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
