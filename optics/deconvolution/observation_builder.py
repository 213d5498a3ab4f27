"""From what somebody has in hand to a restoration's problem."""

from __future__ import annotations

import torch

from optics.deconvolution.observation import Observation
from optics.operators.blur import Border
from optics.validation import accepts_numpy, as_floating_point


@accepts_numpy
def build_observation(
    image: torch.Tensor,
    psf: torch.Tensor,
    noise: float | None = None,
    border: Border = "unknown",
    weights: torch.Tensor | None = None,
    clipped: torch.Tensor | None = None,
) -> Observation:
    """A blurred photograph, of arrays of any kind: see Observation.

    It is restored in double precision if `image` is, else in single. noise: standard deviation of a
    pixel; estimated from the photograph if None.
    """
    image = as_floating_point(image)
    weights = weights if weights is None else weights.to(image)
    clipped = clipped if clipped is None else clipped.to(torch.bool)
    told = noise if noise is None else float(noise)
    return Observation(image, psf.to(image), told, border, weights, clipped)
