"""Deconvolution that keeps edges: total variation, and the heavier tails of natural pictures."""

from __future__ import annotations

import torch

from optics.deconvolution.method import SETUP_COST, RestorationMethod, splitting_cost
from optics.deconvolution.observation import Observation
from optics.deconvolution.priors import NonNegativity, TotalVariation, weight_by_evidence
from optics.deconvolution.restored_image import RestoredImage
from optics.deconvolution.shrinkage import require_power
from optics.deconvolution.splitting import (
    MIN_EXPLAINED_SHARE,
    DataProx,
    Splitting,
    SplittingSettings,
)
from optics.progress import Progress
from optics.threads import single_threaded
from optics.validation import require_count, require_positive

GRADIENT_THRESHOLD = 0.2
"""Of the picture's standard deviation: the gradient that a first iteration takes for none. A fifth
is fastest."""

_CLIPPED_GRADIENT_THRESHOLD = 1.0
"""The same where some light was clipped: what is looked for there may be many times brighter than
what was seen, and with short steps takes long to get there."""

_MEAN_TO_RMS_GRADIENT = 0.32
"""Mean length of photographs' gradients over its rms."""


@single_threaded
@torch.no_grad()
def total_variation(
    observation: Observation,
    weight: float | None = None,
    *,
    power: float = 1.0,
    iterations: int = 30,
    tol: float = 0.0,
    positive: bool = False,
    data_prox: DataProx | None = None,
    progress: Progress | None = None,
) -> RestoredImage:
    """The photograph with its blur undone: few edges, sharp ones (thesis Eq. 2.27).

    weight: of the sum of gradients' lengths, light per pixel; by the evidence of the picture if
    None, from a start that its spectrum tells. power: of those lengths, above 0 to 1; 0.6 is
    natural pictures'. iterations: at most; ends when the picture's relative change is tol.
    positive: whether light may be negative nowhere while it is looked for, which dark pictures
    need; the answer is never negative. data_prox: of another misfit than squares, see Splitting.
    Raises ValueError for a weight that isn't positive, or a power outside 0 to 1.
    """
    if weight is not None:
        require_positive("weight", weight, "")
    require_power(power)
    require_count("iterations", iterations)
    gradients = TotalVariation(
        observation.period_shape, _gradient_threshold(observation), power, observation.image.dtype
    )
    bounded = positive or observation.border == "dark"
    bounds = (
        [NonNegativity(observation.period_shape, observation.support, observation.image.dtype)]
        if bounded
        else []
    )
    steps = SplittingSettings(
        iterations, tol, weight, initial_weight(observation, power) if weight is None else 0.0
    )
    name = "total variation" if power == 1 else f"gradients to the power {power:g}"
    name = name if data_prox is None else f"Poisson {name}"
    splitting = Splitting(observation, gradients, bounds, steps, data_prox)
    return splitting.solve(name, progress or Progress())


def _gradient_threshold(observation: Observation) -> float:
    """Length of a gradient that a first iteration takes for none."""
    bright = observation.clipped is not None and bool(observation.clipped.any())
    return (_CLIPPED_GRADIENT_THRESHOLD if bright else GRADIENT_THRESHOLD) * observation.scale


def initial_weight(observation: Observation, power: float = 1.0) -> float:
    """The weight by the evidence of the best linear restoration, which the spectrum tells."""
    explained = observation.wiener_prediction
    length = (_MEAN_TO_RMS_GRADIENT * explained.gradient / observation.psf_sum) ** power
    return weight_by_evidence(
        length, power, observation.scene_noise, max(explained.explained_share, MIN_EXPLAINED_SHARE)
    )


# A PSF of a hundred pixels with a peak in its centre takes 20 to 30 iterations.
METHOD = RestorationMethod(
    "few edges, sharp ones (Eq. 2.27)",
    total_variation, {6: 4.0, 8: 4.1, 12: 4.4, 20: 4.6, 30: 4.7}, 30, SETUP_COST, splitting_cost,
)  # fmt: skip
