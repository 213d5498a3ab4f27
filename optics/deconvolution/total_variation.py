"""Deconvolution that keeps edges: total variation, and the heavier tails of natural pictures."""

from __future__ import annotations

import torch

from optics.deconvolution.blurred import Blurred
from optics.deconvolution.method import PREPARED, Method, splitting_work
from optics.deconvolution.priors import Bounds, TotalVariation, evident_weight
from optics.deconvolution.restored import Restored
from optics.deconvolution.shrinkage import require_power
from optics.deconvolution.splitting import LEAST_FREEDOM, Fit, Splitting, Steps
from optics.edge import require_count, require_positive
from optics.progress import Progress
from optics.threads import single_threaded

STEP = 0.2
"""Of the picture's standard deviation: the gradient that a first iteration takes for none. A fifth
is fastest."""

_STEP_CLIPPED = 1.0
"""The same where some light was clipped: what is looked for there may be many times brighter than
what was seen, and with short steps takes long to get there."""

_TAILS = 0.32
"""Mean length of photographs' gradients over its rms."""


@single_threaded
@torch.no_grad()
def total_variation(
    seen: Blurred,
    weight: float | None = None,
    *,
    power: float = 1.0,
    iterations: int = 30,
    tol: float = 0.0,
    positive: bool = False,
    fit: Fit | None = None,
    progress: Progress | None = None,
) -> Restored:
    """The photograph with its blur undone: few edges, sharp ones (thesis Eq. 2.27).

    weight: of the sum of gradients' lengths, light per pixel; by the evidence of the picture if
    None, from a start that its spectrum tells. power: of those lengths, above 0 to 1; 0.6 is
    natural pictures'. iterations: at most; ends when the picture's relative change is tol.
    positive: whether light may be negative nowhere while it is looked for, which dark pictures
    need; the answer is never negative. fit: of another misfit than squares, see split().
    Raises ValueError for a weight that isn't positive, or a power outside 0 to 1.
    """
    if weight is not None:
        require_positive("weight", weight, "")
    require_power(power)
    require_count("iterations", iterations)
    gradients = TotalVariation(seen.whole, _step_for(seen), power, seen.image.dtype)
    bounded = positive or seen.border == "dark"
    bounds = [Bounds(seen.whole, seen.lit, seen.image.dtype)] if bounded else []
    steps = Steps(iterations, tol, weight, first_weight(seen, power) if weight is None else 0.0)
    name = "total variation" if power == 1 else f"gradients to the power {power:g}"
    name = name if fit is None else f"Poisson {name}"
    splitting = Splitting(seen, gradients, bounds, steps, fit)
    return splitting.restored(name, progress or Progress())


def _step_for(seen: Blurred) -> float:
    """Length of a gradient that a first iteration takes for none."""
    bright = seen.clipped is not None and bool(seen.clipped.any())
    return (_STEP_CLIPPED if bright else STEP) * seen.scale


def first_weight(seen: Blurred, power: float = 1.0) -> float:
    """The weight by the evidence of the best linear restoration, which the spectrum tells."""
    explained = seen.explained
    length = (_TAILS * explained.gradient / seen.gain) ** power
    return evident_weight(length, power, seen.deviation, max(explained.freedom, LEAST_FREEDOM))


# A PSF of a hundred pixels with a peak in its centre takes 20 to 30 iterations.
METHOD = Method(
    "few edges, sharp ones (Eq. 2.27)",
    total_variation, {6: 4.0, 8: 4.1, 12: 4.4, 20: 4.6, 30: 4.7}, 30, PREPARED, splitting_work,
)  # fmt: skip
