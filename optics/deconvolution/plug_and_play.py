"""Deconvolution with a denoiser in the prior's place."""

from __future__ import annotations

import math
from collections.abc import Callable

import torch

from optics.deconvolution.blurred import Blurred
from optics.deconvolution.normal import NormalEquations
from optics.deconvolution.restored import Restored, relative_change
from optics.deconvolution.total_variation import total_variation
from optics.edge import require_positive
from optics.fourier import rfft2
from optics.progress import Progress
from optics.threads import single_threaded

Denoise = Callable[[torch.Tensor, float], torch.Tensor]
"""Of a picture, (rows, columns) with white at about 1, and the standard deviation of its noise: the
picture without it."""

_FIRST, _LAST = 0.15, 0.004
"""Levels of the denoiser, of white: in the first round, and at least in the last."""

_STEPS = 6
"""Of conjugate gradients, in each round: each starts where the last one ended."""

_START = 15
"""Iterations of total variation to start from."""

_WHITE = 0.999
"""Quantile of a picture that counts as white."""


@single_threaded
@torch.no_grad()
def plug_and_play(
    seen: Blurred,
    denoise: Denoise,
    *,
    strength: float = 0.3,
    rounds: int = 8,
    progress: Progress | None = None,
) -> Restored:
    """The photograph with its blur undone, as a denoiser would have pictures be (Venkatakrishnan
    et al. 2013, doi 10.1109/GlobalSIP.2013.6737048).

    Half-quadratic splitting with falling levels (Zhang et al. 2021, doi
    10.1109/TPAMI.2021.3088914): in turn the denoised picture z, and the x of the least
    |H x - y|² + strength (noise / level)² |x - z|², trusted pixels alone, from a restoration by
    total variation on. Levels fall evenly in logarithms, to that of the photograph's noise.
    Raises ValueError for a strength that isn't positive, or no round.
    """
    require_positive("strength", strength, "")
    if rounds < 1:
        raise ValueError(f"rounds is {rounds}; at least 1 is needed")
    progress = progress or Progress()
    start = total_variation(seen, iterations=_START, progress=progress.part(0, 0.1)).whole
    assert start is not None
    white = max(float(torch.quantile(_some(seen.frame(start)), _WHITE)), seen.scale)
    noise = max(seen.deviation / white, 1e-6)
    levels = torch.logspace(math.log10(_FIRST), math.log10(max(noise, _LAST)), rounds).tolist()
    equations = NormalEquations(seen)
    picture, spectrum, change = start, rfft2(start - equations.mean), list[float]()
    for number, level in enumerate(levels):
        progress.report(0.1 + 0.9 * number / rounds, f"plug-and-play {number + 1}/{rounds}")
        wanted = denoise(picture / white, level).mul_(white).clamp_(min=0)
        if seen.lit is not None:
            wanted.mul_(seen.lit)
        penalty = torch.full_like(seen.power, strength * (noise / level) ** 2)
        near = rfft2(wanted - equations.mean)
        spectrum, _ = equations.solved(penalty, spectrum, _STEPS, near)
        before, picture = picture, equations.picture(spectrum)
        change.append(relative_change(picture, before))
    return Restored(
        seen.frame(picture).clamp(min=0),
        "plug-and-play",
        seen.noise,
        equations.residual(spectrum),
        strength,
        rounds,
        change,
        whole=picture,
    )


def _some(picture: torch.Tensor) -> torch.Tensor:
    """Of large pictures not every value, for statistics."""
    return picture.flatten()[:: max(1, picture.numel() >> 18)]
