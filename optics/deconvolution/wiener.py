"""Linear restoration: Wiener's filter (thesis Eq. 2.28), with an unknown border."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal

import torch

from optics.deconvolution.method import SETUP_COST, RestorationCost, RestorationMethod
from optics.deconvolution.noise import squared_frequencies
from optics.deconvolution.normal_equations import NormalEquations
from optics.deconvolution.observation import Observation
from optics.deconvolution.restored_image import RestoredImage
from optics.progress import Progress
from optics.threads import single_threaded
from optics.validation import require_positive

PenaltyKind = Literal["spectrum", "gradient", "flat"]

PENALTY_KINDS: tuple[PenaltyKind, ...] = ("gradient", "spectrum", "flat")

Frequencies = tuple[slice, slice]
"""Rows and columns of an rfft2 grid."""

_STEPS = 30
"""Of conjugate gradients, after which what isn't measured hardly changes what lies inside."""

_TRIAL_WEIGHTS = torch.logspace(-8, 2, 61, dtype=torch.float64)
"""Weights that are tried, relative to what a gradient of one period a pixel would be worth."""

_SAMPLED_FREQUENCIES = 1 << 12
"""Frequencies of which the error is predicted, about."""


@single_threaded
def wiener(
    observation: Observation,
    weight: float | None = None,
    penalty_kind: PenaltyKind = "gradient",
    *,
    steps: int = _STEPS,
) -> RestoredImage:
    """The picture H* O / (|H|² + K), (rows, columns): linear, so that it may be negative where the
    light is dim. Differentiable.

    penalty_kind: what K is. "gradient", a weight times the frequency's square; "spectrum", the
    noise over the picture's power at each frequency, which the photograph tells: the least error
    that a linear filter can have, where PSF and noise are exact; "flat", a weight everywhere, as in
    Eq. 2.28. weight: of K; the one with the least predicted error if None. The mean brightness is
    set apart: no K darkens it.

    steps: where not all of a period was measured, the filter for the measured pixels alone is the
    solution of (H* M H + K) x = H* M y, by conjugate gradients on frequencies, from what the filter
    makes of a smooth continuation; so many steps at most.
    Raises ValueError for a weight that isn't positive, or another name.
    """
    if penalty_kind not in PENALTY_KINDS:
        raise ValueError(
            f"penalty_kind is {penalty_kind!r}; take one of {', '.join(PENALTY_KINDS)}"
        )
    if weight is not None:
        require_positive("weight", weight, "")
    if steps < 0:
        raise ValueError(f"steps is {steps}; it can't be negative")
    equations = NormalEquations(observation)
    penalty, used = penalty_of(observation, weight, penalty_kind)
    spectrum, taken = equations.solve(penalty, equations.initial_spectrum(penalty), steps)
    found = spectrum.detach()
    return RestoredImage(
        observation.crop_to_frame(equations.picture(spectrum)),
        f"Wiener, {penalty_kind}",
        observation.noise,
        # It takes as long as a third of the rest.
        lambda: equations.residual(found),
        used,
        1 + taken,
    )


def penalty_of(
    observation: Observation, weight: float | None, penalty_kind: PenaltyKind
) -> tuple[torch.Tensor, float]:
    """K of each frequency of the whole period, and its weight: see wiener()."""
    squares = squared_frequencies(observation.period_shape)
    if penalty_kind == "spectrum":
        shape, best = _noise_to_signal(observation, squares), 1.0
    else:
        shape, best = torch.ones_like(squares) if penalty_kind == "flat" else squares, 0.0
        if weight is None:
            power = observation.squared_mtf.to(torch.float64, copy=True)
            power.clamp_(min=1e-30)
            best = least_error_weight(
                observation, lambda k, at: power[at] / (power[at] + k * shape[at])
            )
    used = best if weight is None else weight
    return (used * shape).to(observation.squared_mtf), used


def _noise_to_signal(observation: Observation, squares: torch.Tensor) -> torch.Tensor:
    """Of each frequency, by its square; what lies below the lowest of the frame is as likely as
    that."""
    law, at = observation.power_law, squares.clamp(min=max(observation.period_shape) ** -2)
    noise = (observation.scene_noise * observation.psf_sum) ** 2
    return noise / (max(law.strength, 1e-30) * at ** (-law.slope / 2))


def least_error_weight(
    observation: Observation, system_response: Callable[[float, Frequencies], torch.Tensor]
) -> float:
    """The weight with the least mean square error that the photograph's spectrum predicts.

    system_response: of a weight, the share of the scene that gets through blur and filter at some
    of the frequencies of the whole period.
    """
    every = slice(
        None, None, max(1, math.isqrt(observation.squared_mtf.numel() // _SAMPLED_FREQUENCIES))
    )
    at = every, every
    signal = 1 / _noise_to_signal(observation, squared_frequencies(observation.period_shape)[at])
    lost = observation.squared_mtf[at].to(torch.float64).clamp(min=1e-30)

    def error(weight: float) -> float:
        share = system_response(weight, at).to(torch.float64)
        return float(((1 - share).square() * signal + share.square() / lost).mean())

    return min(_TRIAL_WEIGHTS.tolist(), key=error)


_MASKED_STEPS = 10
"""Where pixels within the frame are missing, at least."""


def _solve(
    observation: Observation, weight: float | None, *, iterations: int, progress: Progress
) -> RestoredImage:
    least = 0 if observation.effective_weights is None else _MASKED_STEPS
    return wiener(observation, weight, steps=max(iterations - 1, least))


def _iteration_cost(observation: Observation) -> RestorationCost:
    """Of conjugate gradients, of which a period seen whole takes none."""
    return RestorationCost(0, 0) if observation.is_fully_measured else RestorationCost(2, 24)


# Without a step, what lies beyond the frame is continued smoothly.
METHOD = RestorationMethod(
    "linear filter, gradients' power known (Eq. 2.28)",
    _solve, {1: 1.7, 11: 3.3, 31: 3.4}, 31, SETUP_COST, _iteration_cost,
)  # fmt: skip
