"""The Wiener filter (thesis Eq. 2.28), with an unknown border."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import torch

from optics.fourier import irfft2, rfft2
from optics.inverse.method import SETUP_COST, Gain, RestorationCost, RestorationMethod
from optics.inverse.noise import squared_frequencies
from optics.inverse.normal_equations import NormalEquations, least_weight
from optics.inverse.observation import Observation
from optics.inverse.own_terms import in_own_unit
from optics.inverse.restored_image import RestoredImage
from optics.progress import Progress
from optics.threads import single_threaded
from optics.validation import require_positive

PenaltyKind = Literal["spectrum", "gradient", "flat"]

PENALTY_KINDS: tuple[PenaltyKind, ...] = ("gradient", "spectrum", "flat")

Frequencies = tuple[slice, slice]
"""Rows and columns of an rfft2 grid."""

# Relative residual of the equations from which more steps change the picture by little. Of 160
# restorations with 10 PSFs, those within it were within 1.5 % and 0.15 dB of the solution.
_CONVERGED_RESIDUAL = 1e-4

# Weights among which the best one is chosen: K at a frequency of one cycle per pixel.
_TRIAL_WEIGHTS = torch.logspace(-8, 2, 61, dtype=torch.float64)


@single_threaded
@in_own_unit(centred=True)
def wiener(
    observation: Observation,
    weight: float | None = None,
    penalty_kind: PenaltyKind = "gradient",
    *,
    steps: int = 30,
) -> RestoredImage:
    """Deblur a photograph by the Wiener filter, ``H* O / (|H|² + K)``.

    The filter is linear, so that the result may be negative where the light is dim, and it is
    differentiable. The mean of the photograph isn't changed by K.

    If part of the period wasn't measured, the filter for the measured pixels is the solution of (H*
    M H + K) x = H* M y. Conjugate gradients on frequencies find it, starting from the smooth
    continuation of the photograph, which is filtered if the PSF is narrow. Derivatives by
    photograph and PSF are those of the solution, not of its steps.

    Raises ValueError for a weight that isn't positive, or another name of the penalty.

    weight: factor of K. If None, the one with the least predicted error of those that `steps` can
        solve.
    penalty_kind: the shape of K. "gradient": the squared frequency. "spectrum": the ratio of noise
        to signal power at each frequency, which is estimated from the photograph. No linear filter
        has a smaller error if PSF and noise are exact. "flat": the same for all frequencies, as in
        Eq. 2.28 of the thesis.
    steps: largest number of steps of conjugate gradients. After 30 steps, the unmeasured
        surroundings hardly change the picture in the frame.
    """
    if penalty_kind not in PENALTY_KINDS:
        raise ValueError(
            f"penalty_kind is {penalty_kind!r}; take one of {', '.join(PENALTY_KINDS)}"
        )
    if weight is not None:
        require_positive("weight", weight, "")
    if steps < 0:
        raise ValueError(f"steps is {steps}; it can't be negative")
    shape = _penalty_shape(observation, penalty_kind, squared_frequencies(observation.period_shape))
    used = _best_weight(observation, penalty_kind, shape, steps) if weight is None else weight
    penalty = (used * shape).to(observation.squared_mtf)
    recorded = observation.records_derivatives
    # A fresh observation has computed nothing yet without recording its derivatives.
    equations = NormalEquations(replace(observation) if recorded else observation)
    if steps == 0 or observation.is_fully_measured:
        spectrum, taken = equations.initial_spectrum(penalty), 0
        picture, converged = equations.picture(spectrum), observation.is_fully_measured
    else:
        with torch.no_grad():
            plain = NormalEquations(observation)
            # The smooth continuation is the best start where the PSF is wide.
            wide = observation.is_wide_beyond_frame
            start = plain.extended_spectrum() if wide else plain.initial_spectrum(penalty)
            spectrum, taken, left = plain.solve(plain.data_spectrum, penalty, start, steps)
        converged = left <= _CONVERGED_RESIDUAL

        def solve(change: torch.Tensor) -> torch.Tensor:
            wanted = rfft2(change)
            answer, *_ = equations.solve(wanted, penalty, torch.zeros_like(wanted), steps)
            return irfft2(answer, observation.period_shape)

        picture = (
            equations.picture_with_gradients(spectrum, lambda _: spectrum * penalty, solve)
            if recorded
            else equations.picture(spectrum)
        )
    found = spectrum.detach()
    return RestoredImage(
        observation.crop_to_picture(picture),
        f"Wiener, {penalty_kind}",
        observation.noise,
        # The residual takes a third of the other time. Therefore it is computed only if needed.
        lambda: equations.mean_squared_residual(found) ** 0.5,
        used,
        1 + taken,
        converged=converged,
        period_image=picture,
    )


def _penalty_shape(
    observation: Observation, penalty_kind: PenaltyKind, squares: torch.Tensor
) -> torch.Tensor:
    """Return K for a weight of 1, by squared frequencies in (cycles/pixel)²."""
    if penalty_kind == "spectrum":
        return _noise_to_signal(observation, squares)
    return torch.ones_like(squares) if penalty_kind == "flat" else squares


def _best_weight(
    observation: Observation, penalty_kind: PenaltyKind, shape: torch.Tensor, steps: int
) -> float:
    """Return the weight of K with the least predicted error of those that `steps` can solve."""
    least = least_weight(
        observation, lambda squares: _penalty_shape(observation, penalty_kind, squares), steps
    )
    if penalty_kind == "spectrum":
        return max(1.0, least)
    power = observation.squared_mtf.detach().to(torch.float64, copy=True)
    power.clamp_(min=1e-30)
    best = least_error_weight(observation, lambda k, at: power[at] / (power[at] + k * shape[at]))
    return max(best, least)


def _noise_to_signal(observation: Observation, squares: torch.Tensor) -> torch.Tensor:
    """Return the noise-to-signal power ratio by squared frequency, (cycles/pixel)².

    Frequencies below the lowest one of the period get the ratio of the lowest one.
    """
    law, at = observation.power_law, squares.clamp(min=max(observation.period_shape) ** -2)
    noise = (observation.disturbance * observation.psf_sum) ** 2
    return noise / (max(law.strength, 1e-30) * at ** (-law.slope / 2))


def least_error_weight(
    observation: Observation, system_response: Callable[[float, Frequencies], torch.Tensor]
) -> float:
    """Find the weight of a linear filter with the least predicted mean square error.

    The prediction uses the photograph's spectrum.

    system_response: returns the transfer function of blur and filter together, for a weight and
        some frequencies of the period.
    """
    # About 4000 frequencies are enough for the prediction.
    every = slice(None, None, max(1, math.isqrt(observation.squared_mtf.numel() // (1 << 12))))
    at = every, every
    signal = 1 / _noise_to_signal(observation, squared_frequencies(observation.period_shape)[at])
    lost = observation.squared_mtf[at].to(torch.float64).clamp(min=1e-30)

    def error(weight: float) -> float:
        share = system_response(weight, at).to(torch.float64)
        return float(((1 - share).square() * signal + share.square() / lost).mean())

    return min(_TRIAL_WEIGHTS.tolist(), key=error)


def _solve(
    observation: Observation, weight: float | None, *, iterations: int, progress: Progress
) -> RestoredImage:
    # Pixels that are missing within the frame need at least 10 steps.
    least = 0 if observation.effective_weights is None else 10
    return wiener(observation, weight, steps=max(iterations - 1, least))


# Fewer steps, with wide PSFs and beyond the frame, may end below the blurred picture.
METHOD = RestorationMethod(
    "linear filter, gradients' power known (Eq. 2.28)",
    _solve, {
        6: Gain(6.06, -0.41, 0.07, 1.29, -0.18, -1.58),
        11: Gain(6.64, -0.56, 0.46, 1.31, 0.07, -1.26),
        31: Gain(7.04, -0.73, 0.78, 1.40, 0.18, -0.93),
    }, 31, SETUP_COST,
    lambda seen: RestorationCost(0, 0) if seen.is_fully_measured else RestorationCost(2, 24),
)  # fmt: skip
