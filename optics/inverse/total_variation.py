"""Deblur with a total-variation prior, or with a lower power of the gradients."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import torch

from optics.fourier import rfft2
from optics.inverse.band_coupling import BandCoupling
from optics.inverse.frequency_step import DataProx, frequency_step
from optics.inverse.method import SETUP_COST, Gain, RestorationMethod, splitting_cost
from optics.inverse.normal_equations import NormalEquations
from optics.inverse.observation import MIN_EXPLAINED_SHARE, Observation
from optics.inverse.own_terms import in_own_unit
from optics.inverse.priors import (
    LEAST_WEIGHT_SHARE,
    Box,
    DerivativePenalty,
    LinearisedBox,
    LinearisedPenalty,
    LinearTerm,
    Prior,
    weight_by_evidence,
)
from optics.inverse.restored_image import RestoredImage
from optics.inverse.splitting import (
    SplitSolution,
    SplittingSettings,
    restored_image,
    solve_by_splitting,
)
from optics.progress import Progress
from optics.threads import single_threaded
from optics.validation import (
    needs_gradient,
    require_count,
    require_positive,
)


def require_power(power: float) -> None:
    """Raise ValueError unless a power of gradients is above 0 and up to 1."""
    if not 0 < power <= 1:
        raise ValueError(f"power is {power:g}; give one above 0, up to 1")


GRADIENT_THRESHOLD = 0.2
"""Length of the gradients that a first iteration sets to 0, relative to the picture's standard
deviation. This value is the fastest."""


# Over-relaxation of the split gradients. Of 1, 1.5 and 1.8 with four PSFs, two noises and 12 to
# 60 iterations, 1.5 is up to 0.17 dB better than 1; 1.8 is as good, but not with clipped pixels.
# It doesn't serve penalties that aren't convex, nor the likelihood of photons.
_RELAXATION = 1.4

# Weight of the luminance beside colour differences. Of 0.3, 0.5 and 0.7, the best for five
# photographs, blurred by a disk or by a ring for each colour.
_LUMINANCE_WEIGHT = 0.5

# Least estimated weight of a scene with several bands, relative to the scale of its light. What
# neither filters nor PSFs determine needs a prior also where there is no noise.
_LEAST_BAND_WEIGHT = 3e-4


# Factor on the estimated weight for photographs with a variance map. The gradients from which the
# weight is estimated are mostly those of the brightest parts. Measured on nine photographs of
# three scenes with three PSFs, of 1, 1.5 and 2.2: the gain in light is 0.6 dB, 0.7 dB and 0.5 dB,
# and that in its logarithm -1.2 dB, -0.2 dB and 0.4 dB.
_VARIED_WEIGHT = 1.8


def light_in_weight(given: Mapping[str, Any]) -> float:
    """Return the power of the light's unit in the weight of a gradient penalty."""
    return 2 - float(given["power"])


@single_threaded
@in_own_unit(weight=light_in_weight, upper=1, data_prox=1, centred=True)
def total_variation(
    observation: Observation,
    weight: float | torch.Tensor | None = None,
    *,
    power: float = 1.0,
    bands: BandCoupling | None = None,
    iterations: int = 30,
    tol: float = 0.0,
    positive: bool = False,
    upper: float = math.inf,
    data_prox: DataProx | None = None,
    weight_factor: float = 1.0,
    progress: Progress | None = None,
) -> RestoredImage:
    """Deblur with the total-variation prior, which keeps edges sharp (thesis Eq. 2.27).

    The picture is nowhere negative. It has derivatives by photograph, PSFs, pixel weights and
    `weight` where these record them: those of the exact solution, which the iterations must have
    reached about. What is flat in it stays flat, and clipped pixels have none.

    Raises ValueError for a weight that isn't positive, or a power outside 0 to 1.

    weight: regularisation weight of the sum of the gradients' lengths, in light per pixel. If None,
        the photograph's spectrum predicts a first value, and the evidence of the picture refines
        it.
    power: power of the gradients' lengths, above 0 and up to 1. It is 0.6 for natural pictures.
    bands: how the scene's bands are coupled. If None, luminance and colour differences are
        penalised separately.
    iterations: largest number of iterations.
    tol: relative change of the picture at which the iteration ends; 0 for all iterations.
    positive: whether the light is kept from being negative in each iteration, which dark pictures
        need.
    upper: bound that the light doesn't exceed, above 0.
    data_prox: proximal step of another data term than least squares: see DataProx.
    weight_factor: factor on a weight that is estimated, above 0.
    """
    number = None
    if weight is not None:
        number = float(torch.as_tensor(weight).detach())
        require_positive("weight", number, "")
    require_power(power)
    require_count("iterations", iterations)
    name = "total variation" if power == 1 else f"gradients to the power {power:g}"
    name = name if data_prox is None else f"Poisson {name}"
    coupling = bands or BandCoupling.luminance_chrominance(observation.bands, _LUMINANCE_WEIGHT)
    if coupling.bands != observation.bands:
        raise ValueError(f"bands couples {coupling.bands}; the scene has {observation.bands}")
    # Clipped light may be many times brighter than the measured value. With a small threshold, it
    # would take many iterations to reach it.
    bright = observation.clipped is not None and bool(observation.clipped.any())
    penalty = DerivativePenalty(
        coupling, observation.period_shape,
        (1.0 if bright else GRADIENT_THRESHOLD) * observation.scale,
        observation.image.dtype, power=power,
        relaxation=_RELAXATION if power == 1 and data_prox is None else 1.0,
        weight_factor=weight_factor,
    )  # fmt: skip
    require_positive("weight_factor", weight_factor, "")
    if not upper > 0:
        raise ValueError(f"upper is {upper:g}; it must be above 0, the lower bound of light")
    bounded = positive or upper < math.inf or observation.border == "dark"
    bounds = [Box(observation.support, upper)] if bounded else []
    is_grey = observation.relative_filters is None
    with torch.no_grad():
        settings = weight_settings(
            observation, penalty, number, iterations, tol, power, is_predictable=is_grey
        )
        step = frequency_step(observation, iterations, data_prox, coupling)
        priors = [penalty, *bounds]
        solution = solve_by_splitting(step, priors, settings, name, progress or Progress())
    if observation.records_derivatives or (weight is not None and needs_gradient(weight)):
        if power != 1 or data_prox is not None:
            raise ValueError(f"{name} has no derivatives; take a power of 1 and least squares")
        weight = solution.weight if weight is None else weight
        settings = SplittingSettings(iterations, solution.weight, tol=tol, starts_from_picture=True)
        picture = _picture_with_gradients(observation, penalty, bounds, solution, weight, settings)
        solution = replace(solution, picture=picture)
    return restored_image(step, solution, name, upper=upper)


def _picture_with_gradients(
    observation: Observation,
    penalty: DerivativePenalty,
    bounds: Sequence[Box],
    solution: SplitSolution,
    weight: float | torch.Tensor,
    settings: SplittingSettings,
) -> torch.Tensor:
    """Return the picture with its derivatives, which take as many iterations as the picture."""
    # A fresh observation has computed nothing yet without recording its derivatives.
    equations = NormalEquations(replace(observation), keeps_mean=True)
    found = solution.picture.detach()

    def solve(change: torch.Tensor) -> torch.Tensor:
        priors: list[Prior] = [LinearisedPenalty(penalty, found)]
        priors += [LinearisedBox(box, found) for box in bounds]
        # The same problem for a dark photograph, on the same scale; clipped pixels have no weight.
        seen = replace(
            observation, image=torch.zeros_like(observation.image),
            weights=observation.effective_weights, clipped=None,
        )  # fmt: skip
        seen.__dict__["scale"] = observation.scale
        step = frequency_step(seen, settings.iterations, bands=penalty.bands)
        linear = [*priors, LinearTerm(change)]
        return solve_by_splitting(
            step, linear, settings, "derivatives", Progress(), torch.zeros_like(found)
        ).picture

    return equations.picture_with_gradients(
        rfft2(found), lambda pull: pull.detach() * (weight / settings.weight), solve
    )


def weight_settings(
    observation: Observation,
    penalty: DerivativePenalty,
    weight: float | None,
    iterations: int,
    tol: float = 0.0,
    power: float = 1.0,
    *,
    is_predictable: bool,
) -> SplittingSettings:
    """Choose how the weight is found: as given, or by the evidence of the pictures if None.

    is_predictable: whether the photograph's spectrum predicts the weight well, so that it needn't
        move far.
    """
    if weight is not None:
        return SplittingSettings(iterations, weight, tol=tol)
    varied = 1.0 if observation.variance is None else _VARIED_WEIGHT
    delay, limits = (5, (LEAST_WEIGHT_SHARE, 2.5)) if is_predictable else (3, (1 / 8, 8.0))
    least = 0.0
    if observation.relative_filters is None:
        first = varied * initial_weight(observation, power)
    else:
        # Blur and interpolation make the first picture smoother than the scene.
        least = _LEAST_BAND_WEIGHT * observation.scale ** (2 - power)
        smooth = penalty.estimate_weight(observation.extended_image, observation.disturbance, 1.0)
        first = max(0.5 * smooth, least)

    def estimate(picture: torch.Tensor, used: float, residual: float) -> float:
        freedom = observation.explained_share(residual)
        wanted = varied * penalty.estimate_weight(picture, observation.disturbance, freedom)
        # Before the iterations have converged, the picture explains too little, and would ask for
        # less weight. So the weight goes 30 % of the way, in logarithms.
        target = min(max(wanted, least, first * limits[0]), first * limits[1])
        return used * (target / used) ** 0.3

    return SplittingSettings(iterations, first, estimate, delay, tol)


def initial_weight(observation: Observation, power: float = 1.0) -> float:
    """Predict the weight from the evidence of the picture that the Wiener filter would restore."""
    law = observation.power_law
    share, gradient = law.wiener_prediction(*observation.squared_mtf_of_centre)
    # The mean length of photographs' gradients is 0.32 of the rms length.
    length = (0.32 * gradient / observation.psf_sum) ** power
    return weight_by_evidence(
        length, power, observation.disturbance, max(share, MIN_EXPLAINED_SHARE)
    )


# With a PSF of a hundred pixels that has a central peak, total variation takes 20 to 30 iterations.
METHOD = RestorationMethod(
    "few edges, sharp ones (Eq. 2.27)",
    total_variation, {
        12: Gain(8.25, -0.84, 1.09, 1.10, 0.41, -1.00),
        20: Gain(8.49, -0.97, 1.21, 1.20, 0.42, -0.83),
        30: Gain(8.56, -1.03, 1.29, 1.26, 0.40, -0.74),
        60: Gain(8.54, -1.10, 1.32, 1.35, 0.33, -0.64),
    }, 30, SETUP_COST,
    splitting_cost,
    slow_if_wide=True,
    restores_bands=True,
    takes_variance=True,
)  # fmt: skip
