"""From what somebody has in hand to a restoration's problem."""

from __future__ import annotations

import torch

from optics.deconvolution.blurred import Blurred
from optics.edge import floating, tensors_inside
from optics.operators.blur import Border


@tensors_inside
def measured(
    image: torch.Tensor,
    psf: torch.Tensor,
    noise: float | None = None,
    border: Border = "unknown",
    weights: torch.Tensor | None = None,
    clipped: torch.Tensor | None = None,
) -> Blurred:
    """A blurred photograph, of arrays of any kind: see Blurred.

    It is restored in double precision if `image` is, else in single. noise: standard deviation of a
    pixel; estimated from the photograph if None.
    """
    image = floating(image)
    weights = weights if weights is None else weights.to(image)
    clipped = clipped if clipped is None else clipped.to(torch.bool)
    told = noise if noise is None else float(noise)
    return Blurred(image, psf.to(image), told, border, weights, clipped)
