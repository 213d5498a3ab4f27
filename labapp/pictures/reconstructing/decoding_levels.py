"""Estimate the noise and the white of a photograph before its decoding, from itself alone."""

from __future__ import annotations

import numpy as np
import torch

from labapp.common.errors import UserError
from labapp.pictures.reconstructing.problem import WHITE_PERCENTILE, RestorationProblem
from optics.edof.learned import CaptureFilter, WienerFront
from optics.edof.spectral_criterion import LEAST_NOISE
from optics.inverse.observation_builder import build_observation

_PASSES = 2
"""Passes of the decoder's filter by which white is found. Measured on 16 simulated photographs:
after 2, decoding loses 0.03 dB against the true white, and a third changes white by less than 1 %.
With white from the photograph itself, it loses 0.3 to 0.8 dB: a pattern takes contrast away."""


def noise_level(problem: RestorationProblem) -> float:
    """Return a photograph's noise, as told, or estimated by what its mean PSF leaves.

    It is in the unit of the photograph. An estimate is at least what is known to be there. Raises
    UserError for a told one that exceeds the photograph.
    """
    if problem.noise is not None:
        brightest = float(problem.light.max())
        if problem.noise >= brightest:
            raise UserError(
                f"--noise {problem.noise:g}: the photograph's brightest pixel is {brightest:g}. "
                "Give the noise in the same unit."
            )
        return problem.noise
    observation = build_observation(torch.from_numpy(problem.light[0]), problem.psf[0])
    return max(observation.noise, problem.noise_floor)


def estimate_white(problem: RestorationProblem, front: WienerFront, noise: float) -> float:
    """Estimate the white of the scene, which the decoder's scale refers to.

    It is the brightness, in the photograph's unit, of the brightest pixels once the decoder's
    filter has given back the contrast that the pattern takes. The true picture isn't looked at.
    UserError if the photograph is dark.

    problem: the photograph in one band, without gaps.
    noise: standard deviation of a pixel's noise, in the unit of the photograph.
    """
    light = problem.light[0]
    passed = float(front.mean[0, 0].real)
    white = _require_light(float(np.percentile(light, WHITE_PERCENTILE)) / passed, problem)
    for _ in range(_PASSES):
        share = max(noise / white, LEAST_NOISE)
        filtered = CaptureFilter(front, share)(torch.from_numpy(light / white)).numpy()
        white *= _require_light(float(np.percentile(filtered, WHITE_PERCENTILE)), problem)
    return white


def _require_light(white: float, problem: RestorationProblem) -> float:
    """Return the white of a photograph; UserError if it is dark."""
    if not white > 0:
        raise UserError(f"{problem.source}: is dark. Expose it longer, or check --dark.")
    return white
