"""From what somebody has in hand to a restoration's problem."""

from __future__ import annotations

from dataclasses import replace

import torch

from optics.deconvolution.blurred import Blurred
from optics.deconvolution.noise import estimated_noise
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
    """A blurred photograph in single precision, of arrays of any kind: see Blurred.

    noise: standard deviation of a pixel; estimated from the photograph if None.
    """
    image, psf = (floating(one).to(torch.float32) for one in (image, psf))
    weights = weights if weights is None else weights.to(torch.float32)
    clipped = clipped if clipped is None else clipped.to(torch.bool)
    seen = Blurred(image, psf, 0.0 if noise is None else float(noise), border, weights, clipped)
    return replace(seen, noise=estimated_noise(seen)) if noise is None else seen
