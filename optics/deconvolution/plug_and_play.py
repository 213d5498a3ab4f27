"""Deconvolution with a denoiser in the prior's place."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from optics.deconvolution.blurred import Blurred
from optics.deconvolution.method import PREPARED, Denoise, Method, Work
from optics.deconvolution.normal import NormalEquations
from optics.deconvolution.restored import Restored, relative_change
from optics.deconvolution.total_variation import total_variation
from optics.edge import require_count, require_positive
from optics.fourier import half_counts, rfft2
from optics.progress import Progress
from optics.threads import single_threaded

_FIRST, _LEAST = 0.15, 0.002
"""Levels of the denoiser, of white: in the first round, and at least in any."""

_CAUTION, _PEAKED = 1.3, 0.6
"""The level that is told, over the noise that a linear step leaves; that noise is between its rms
over all frequencies and at the worst one, a logarithmic share of the way: some frequencies have
far more than others, and a denoiser that is told the mean takes them for texture."""

_LOOSEST = 1e-7
"""Penalty, over |H|² of what isn't blurred, below which the first round never goes."""

_STEPS = 6
"""Of conjugate gradients, in each round: each starts where the last one ended."""

_START = 15
"""Iterations of total variation to start from."""

_SOME = 1 << 14
"""Frequencies of which the noise is reckoned, about."""

_WHITE = 0.999
"""Quantile of a picture that counts as white."""


@single_threaded
@torch.no_grad()
def plug_and_play(
    seen: Blurred,
    denoise: Denoise,
    *,
    strength: float = 0.3,
    rounds: int = 12,
    progress: Progress | None = None,
) -> Restored:
    """The photograph with its blur undone, as a denoiser would have pictures be (Venkatakrishnan
    et al. 2013, doi 10.1109/GlobalSIP.2013.6737048).

    Half-quadratic splitting (Zhang et al. 2021, doi 10.1109/TPAMI.2021.3088914): in turn the
    denoised picture z, and the x of the least |H x - y|² + K |x - z|², trusted pixels alone, from
    a restoration by total variation on. K grows evenly in logarithms up to `strength`, or as far
    as there is noise. The denoiser is told the noise that the step before leaves in x, which K and
    the blur tell.
    Raises ValueError for a strength that isn't positive, or no round.
    """
    require_positive("strength", strength, "")
    require_count("rounds", rounds)
    progress = progress or Progress()
    start = total_variation(seen, iterations=_START, progress=progress.part(0, 0.1)).whole
    assert start is not None
    white = max(float(torch.quantile(_some(seen.frame(start)), _WHITE)), seen.scale)
    left = _Left.of(seen, white)
    # Where next to no noise is left, the data need no help.
    tightest = min(left.penalty_for(_LEAST), strength)
    loosest = min(left.penalty_for(_FIRST), tightest)
    penalties = torch.logspace(math.log10(loosest), math.log10(tightest), rounds).tolist()
    equations = NormalEquations(seen)
    picture, spectrum, change = start, rfft2(start - equations.mean), list[float]()
    for number, penalty in enumerate(penalties):
        progress.report(0.1 + 0.9 * number / rounds, f"plug-and-play {number + 1}/{rounds}")
        level = max(left.level(penalty), _LEAST)
        wanted = denoise(picture / white, level).mul_(white).clamp_(min=0)
        if seen.lit is not None:
            wanted.mul_(seen.lit)
        near = rfft2(wanted - equations.mean)
        everywhere = torch.full_like(seen.power, penalty)
        spectrum, _ = equations.solved(everywhere, spectrum, _STEPS, near)
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


@dataclass(frozen=True, eq=False)
class _Left:
    """The noise in the x of the least |H x - y|² + K |x - z|², relative to white.

    noise: of the photograph. power, count: |H|² of each frequency, and for how many it stands.
    """

    noise: float
    power: torch.Tensor
    count: torch.Tensor

    @classmethod
    def of(cls, seen: Blurred, white: float) -> _Left:
        every = max(1, math.isqrt(seen.power.numel() // _SOME))
        count = half_counts(seen.whole[1])[::every].expand(seen.power[::every, ::every].shape)
        return cls(seen.deviation / white, seen.power[::every, ::every].double(), count.double())

    def level(self, penalty: float) -> float:
        """The level that the denoiser is told for a K."""
        squares = self.power / (self.power + penalty).square() * self.count
        mean = math.sqrt(float(squares.sum() / self.count.sum()))
        worst = 0.5 / math.sqrt(penalty)
        return _CAUTION * self.noise * mean ** (1 - _PEAKED) * worst**_PEAKED

    def penalty_for(self, level: float) -> float:
        """The K for which that is the level, or the loosest: by bisection in logarithms."""
        low, high = math.log(_LOOSEST), math.log(1e3)
        for _ in range(40):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self.level(math.exp(middle)) > level else (low, middle)
        return math.exp(high)


def _some(picture: torch.Tensor) -> torch.Tensor:
    """Of large pictures not every value, for statistics."""
    return picture.flatten()[:: max(1, picture.numel() >> 18)]


def _solve(
    seen: Blurred,
    weight: float | None,
    *,
    iterations: int,
    progress: Progress,
    denoise: Denoise | None = None,
) -> Restored:
    if denoise is None:
        raise ValueError("method is plug-and-play, and no denoiser is given; give one")
    chosen = {} if weight is None else {"strength": weight}
    return plug_and_play(seen, denoise, rounds=iterations, progress=progress, **chosen)


_WEIGHTS = 4.4e4
"""Multiplications and additions of the denoiser, a pixel."""


def _round(seen: Blurred) -> Work:
    """A denoised picture, and where part of the period was seen, conjugate gradients."""
    network = Work(2, 100, 1.4 * _WEIGHTS)
    return network if seen.complete else network.plus(Work(12, 150))


METHOD = Method(
    "a learned denoiser for a prior",
    _solve, {8: 4.6, 12: 5.0}, 12, PREPARED.plus(Work(60, 800)), _round, learned=True,
)  # fmt: skip
