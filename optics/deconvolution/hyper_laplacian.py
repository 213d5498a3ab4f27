"""Deconvolution by the heavy tails of natural pictures' gradients: a few closed forms in turn."""

from __future__ import annotations

import torch

from optics.deconvolution.blurred import Blurred
from optics.deconvolution.method import PREPARED, Method, Work
from optics.deconvolution.normal import NormalEquations
from optics.deconvolution.priors import (
    add_gradient,
    evident_weight,
    gradient_adjoint,
    laplacian,
    mean_gradient,
)
from optics.deconvolution.restored import Restored, relative_change
from optics.deconvolution.shrinkage import kept, require_power
from optics.deconvolution.splitting import LEAST_FREEDOM
from optics.deconvolution.total_variation import first_weight
from optics.edge import require_positive
from optics.fourier import rfft2
from optics.progress import Progress
from optics.threads import single_threaded

_LOOSE, _TIGHT = 1.0, 1e3
"""Couplings of the split gradient, first and last, for pictures of unit scale and steps."""

_STEPS = 3
"""Of conjugate gradients, in each round: each starts where the last one ended."""


@single_threaded
@torch.no_grad()
def hyper_laplacian(
    seen: Blurred,
    power: float = 2 / 3,
    weight: float | None = None,
    *,
    rounds: int = 10,
    progress: Progress | None = None,
) -> Restored:
    """The photograph with its blur undone: the least of |H x - y|² / 2, trusted pixels alone,
    + weight * the sum of |∇x|^power (Krishnan and Fergus 2009, "Fast image deconvolution using
    hyper-Laplacian priors", NIPS 22).

    Half-quadratic splitting: gradients that are split off, each shrunk by itself, and the picture
    that is nearest to them and to the data, in turn, while their coupling grows. Lengths of
    gradients count in all directions alike. The problem has many minima: it ends near a good one,
    and more rounds lead to a lower one.

    power: above 0 to 1; 1/2 to 0.8 are natural pictures'. weight: light per pixel to the power
    2 - power; by the evidence of the picture if None. rounds: couplings, evenly spaced in
    logarithms; each costs an FFT pair on a period seen whole, else a few.
    Raises ValueError for a power outside 0 to 1, a weight that isn't positive, or too few rounds.
    """
    require_power(power)
    if weight is not None:
        require_positive("weight", weight, "")
    if rounds < 2:
        raise ValueError(f"rounds is {rounds}; at least 2 are needed, a loose and a tight one")
    progress = progress or Progress()
    equations = NormalEquations(seen)
    square = laplacian(seen.whole).to(seen.power)
    picture, change = seen.continued, list[float]()
    spectrum = rfft2(picture - equations.mean)
    used = first_weight(seen, power) if weight is None else weight
    for number, coupling in enumerate(_couplings(seen.scale, power, rounds)):
        progress.report(number / rounds, f"hyper-Laplacian {number + 1}/{rounds}")
        near = _nearest(picture, power, coupling, square)
        spectrum, _ = equations.solved(square * (used * coupling), spectrum, _STEPS, near)
        before, picture = picture, equations.picture(spectrum)
        if seen.lit is not None:
            picture.mul_(seen.lit)
        change.append(relative_change(picture, before))
        if weight is None:
            used = _evident(seen, picture, power, equations.residual(spectrum))
    return Restored(
        seen.frame(picture).clamp(min=0),
        f"hyper-Laplacian, power {power:.3g}",
        seen.noise,
        equations.residual(spectrum),
        used,
        rounds,
        change,
        whole=picture,
    )


def _couplings(scale: float, power: float, rounds: int) -> list[float]:
    ways = torch.logspace(0, 1, rounds, base=_TIGHT / _LOOSE, dtype=torch.float64)
    return (ways * _LOOSE / scale ** (2 - power)).tolist()


def _nearest(
    picture: torch.Tensor, power: float, coupling: float, square: torch.Tensor
) -> torch.Tensor:
    """Spectrum of the picture whose gradient is nearest to the shrunk one of this."""
    down, along = torch.zeros_like(picture), torch.zeros_like(picture)
    add_gradient(picture, down, along)
    share = kept(torch.addcmul(down * down, along, along), power, coupling)
    wanted = rfft2(gradient_adjoint(down.mul_(share), along.mul_(share), share))
    wanted.div_(square.clamp(min=1e-12))
    wanted[0, 0] = 0
    return wanted


def _evident(seen: Blurred, picture: torch.Tensor, power: float, residual: float) -> float:
    """The weight by the evidence of this picture."""
    freedom = max(1 - residual**2, LEAST_FREEDOM)
    return evident_weight(mean_gradient(picture, power), power, seen.deviation, freedom)


def _solve(seen: Blurred, weight: float | None, *, iterations: int, progress: Progress) -> Restored:
    return hyper_laplacian(seen, weight=weight, rounds=iterations, progress=progress)


def _rounds(seen: Blurred) -> Work:
    return Work(2, 60) if seen.complete else Work(14, 200)


METHOD = Method(
    "gradients with the heavy tails of natural pictures",
    _solve, {5: 3.0, 10: 4.3}, 10, PREPARED, _rounds,
)  # fmt: skip
