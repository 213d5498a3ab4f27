"""Linear restoration: Wiener's filter (thesis Eq. 2.28), with an unknown border."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal

import torch

from optics.deconvolution.blurred import Blurred
from optics.deconvolution.method import PREPARED, Method, Work
from optics.deconvolution.noise import squared_radii
from optics.deconvolution.normal import NormalEquations
from optics.deconvolution.restored import Restored
from optics.edge import require_positive
from optics.progress import Progress
from optics.threads import single_threaded

Smooth = Literal["spectrum", "gradient", "flat"]

SMOOTH: tuple[Smooth, ...] = ("gradient", "spectrum", "flat")

Frequencies = tuple[slice, slice]
"""Rows and columns of an rfft2 grid."""

_STEPS = 30
"""Of conjugate gradients, after which what isn't measured hardly changes what lies inside."""

_GRID = torch.logspace(-8, 2, 61, dtype=torch.float64)
"""Weights that are tried, relative to what a gradient of one period a pixel would be worth."""

_SOME = 1 << 12
"""Frequencies of which the error is predicted, about."""


@single_threaded
def wiener(
    seen: Blurred,
    weight: float | None = None,
    smooth: Smooth = "gradient",
    *,
    steps: int = _STEPS,
) -> Restored:
    """The picture H* O / (|H|² + K), (rows, columns): linear, so that it may be negative where the
    light is dim. Differentiable.

    smooth: what K is. "gradient", a weight times the frequency's square; "spectrum", the noise over
    the picture's power at each frequency, which the photograph tells: the least error that a
    linear filter can have, where PSF and noise are exact; "flat", a weight everywhere, as in Eq.
    2.28. weight: of K; the one with the least predicted error if None. The mean brightness is set
    apart: no K darkens it.

    steps: where not all of a period was measured, the filter for the measured pixels alone is the
    solution of (H* M H + K) x = H* M y, by conjugate gradients on frequencies, from what the filter
    makes of a smooth continuation; so many steps at most.
    Raises ValueError for a weight that isn't positive, or another name.
    """
    if smooth not in SMOOTH:
        raise ValueError(f"smooth is {smooth!r}; take one of {', '.join(SMOOTH)}")
    if weight is not None:
        require_positive("weight", weight, "")
    if steps < 0:
        raise ValueError(f"steps is {steps}; it can't be negative")
    equations = NormalEquations(seen)
    penalty, used = penalty_of(seen, weight, smooth)
    spectrum, taken = equations.solved(penalty, equations.start(penalty), steps)
    found = spectrum.detach()
    return Restored(
        seen.frame(equations.picture(spectrum)),
        f"Wiener, {smooth}",
        seen.noise,
        # It takes as long as a third of the rest.
        lambda: equations.residual(found),
        used,
        1 + taken,
    )


def penalty_of(seen: Blurred, weight: float | None, smooth: Smooth) -> tuple[torch.Tensor, float]:
    """K of each frequency of the whole period, and its weight: see wiener()."""
    squares = squared_radii(seen.whole)
    if smooth == "spectrum":
        shape, best = _noise_to_signal(seen, squares), 1.0
    else:
        shape, best = torch.ones_like(squares) if smooth == "flat" else squares, 0.0
        if weight is None:
            power = seen.power.to(torch.float64, copy=True)
            power.clamp_(min=1e-30)
            best = least_error(seen, lambda k, at: power[at] / (power[at] + k * shape[at]))
    used = best if weight is None else weight
    return (used * shape).to(seen.power), used


def _noise_to_signal(seen: Blurred, squares: torch.Tensor) -> torch.Tensor:
    """Of each frequency, by its square; what lies below the lowest of the frame is as likely as
    that."""
    law, at = seen.law, squares.clamp(min=max(seen.whole) ** -2)
    noise = (seen.deviation * seen.gain) ** 2
    return noise / (max(law.strength, 1e-30) * at ** (-law.slope / 2))


def least_error(seen: Blurred, through: Callable[[float, Frequencies], torch.Tensor]) -> float:
    """The weight with the least mean square error that the photograph's spectrum predicts.

    through: of a weight, the share of the scene that gets through blur and filter at some of the
    frequencies of the whole period.
    """
    every = slice(None, None, max(1, math.isqrt(seen.power.numel() // _SOME)))
    at = every, every
    signal = 1 / _noise_to_signal(seen, squared_radii(seen.whole)[at])
    lost = seen.power[at].to(torch.float64).clamp(min=1e-30)

    def error(weight: float) -> float:
        share = through(weight, at).to(torch.float64)
        return float(((1 - share).square() * signal + share.square() / lost).mean())

    return min(_GRID.tolist(), key=error)


_MASKED_STEPS = 10
"""Where pixels within the frame are missing, at least."""


def _solve(seen: Blurred, weight: float | None, *, iterations: int, progress: Progress) -> Restored:
    least = 0 if seen.trust is None else _MASKED_STEPS
    return wiener(seen, weight, steps=max(iterations - 1, least))


def _step(seen: Blurred) -> Work:
    """Of conjugate gradients, of which a period seen whole takes none."""
    return Work(0, 0) if seen.complete else Work(2, 24)


# Without a step, what lies beyond the frame is continued smoothly.
METHOD = Method(
    "linear filter, gradients' power known (Eq. 2.28)",
    _solve, {1: 1.7, 11: 3.3, 31: 3.4}, 31, PREPARED, _step,
)  # fmt: skip
