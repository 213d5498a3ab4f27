"""Decide whether a picture is restored with its variance map, and say what the map gains."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from labapp.pictures.reconstructing.method_choice import MethodChoice
from labapp.pictures.reconstructing.problem import RestorationProblem
from optics.inverse.observation import Observation
from optics.inverse.observation_builder import with_doubted_variance
from optics.inverse.variance_gain import VarianceGain, estimate_variance_gain

_LEAST_GAIN = 0.1
"""Expected gain of the light in dB from which the map is used. Chosen: nobody sees less."""

_UNEXPLAINED = "the photograph shows far more noise than the map has"

_SEED = 0
"""Seed of the trial's noise: the same picture always gives the same restoration."""


@dataclass(frozen=True)
class VarianceUse:
    """Whether a band was restored with its variance map, and why.

    gain: expected gain over one noise for all pixels; None where it wasn't estimated.
    reason: in words.
    """

    is_used: bool
    gain: VarianceGain | None
    reason: str

    def __str__(self) -> str:
        return f"{'used' if self.is_used else 'not used'}: {self.reason}"


def why_without_map(problem: RestorationProblem) -> VarianceUse | None:
    """Say why a variance map isn't used; None if it may be."""
    if problem.noise is not None:
        return VarianceUse(False, None, "one noise was told for all pixels")
    if problem.filters is not None:
        return VarianceUse(False, None, "light behind colour filters is restored with one noise")
    return None


def choose_variance(
    observation: Observation,
    variance: np.ndarray,
    choice: MethodChoice,
    share: float,
    *,
    has_time: bool,
) -> tuple[Observation, VarianceUse]:
    """Choose whether a band is restored with its variance map; return it as it is to be, and why.

    observation: the band with one noise for all pixels.
    variance: (rows, columns), of each pixel; infinite where nothing was measured.
    share: share of the budget that the band may take.
    has_time: whether there is time for estimating the gain.
    """
    given = torch.from_numpy(variance).to(torch.float64)
    varied = with_doubted_variance(observation, given)
    if varied.variance is None:
        stated = float(given[torch.isfinite(given)].mean()) ** 0.5
        even = "the noise is even" if varied.noise < 1.01 * stated else _UNEXPLAINED
        return observation, VarianceUse(False, None, f"{even}, so that it gains nothing")
    name, solve = choice.variance_solver(varied, share)
    if solve is None:
        return observation, VarianceUse(False, None, f"{name} takes one noise for all pixels")
    if not has_time:
        return varied, VarianceUse(True, None, "its gain wasn't estimated, for want of time")
    try:
        gain = estimate_variance_gain(varied, solve, torch.Generator().manual_seed(_SEED))
    except ValueError as error:
        # The middle may be clipped or dark, though the rest of the photograph isn't.
        return varied, VarianceUse(True, None, f"its gain can't be estimated, because {error}")
    told = (
        f"{gain.light:+.1f} dB expected against one noise for all pixels ({gain.logarithm:+.1f} dB "
        "in the logarithm of the light), by a simulated photograph"
    )
    if not torch.equal(varied.variance, given):
        told += f"; {_UNEXPLAINED}, and the rest was added to it"
    if gain.light < _LEAST_GAIN:
        return observation, VarianceUse(False, gain, f"it gains nothing, {told}")
    return varied, VarianceUse(True, gain, told)
