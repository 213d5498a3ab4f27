"""Deconvolution with a denoiser in the prior's place."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from optics.deconvolution.method import SETUP_COST, Denoise, RestorationCost, RestorationMethod
from optics.deconvolution.normal_equations import NormalEquations
from optics.deconvolution.observation import Observation
from optics.deconvolution.restored_image import RestoredImage, relative_change
from optics.deconvolution.total_variation import total_variation
from optics.fourier import rfft2, rfft_column_weights
from optics.progress import Progress
from optics.threads import single_threaded
from optics.validation import require_count, require_positive

_FIRST_LEVEL, _MIN_LEVEL = 0.15, 0.002
"""Levels of the denoiser, of white: in the first round, and at least in any."""

_LEVEL_FACTOR, _WORST_FREQUENCY_SHARE = 1.3, 0.6
"""The level that is told, over the noise that a linear step leaves; that noise is between its rms
over all frequencies and at the worst one, a logarithmic share of the way: some frequencies have
far more than others, and a denoiser that is told the mean takes them for texture."""

_MIN_PENALTY = 1e-7
"""Penalty, over |H|² of what isn't blurred, below which the first round never goes."""

_STEPS = 6
"""Of conjugate gradients, in each round: each starts where the last one ended."""

_START = 15
"""Iterations of total variation to start from."""

_SAMPLED_FREQUENCIES = 1 << 14
"""Frequencies of which the noise is reckoned, about."""

_WHITE = 0.999
"""Quantile of a picture that counts as white."""


@single_threaded
@torch.no_grad()
def plug_and_play(
    observation: Observation,
    denoise: Denoise,
    *,
    strength: float = 0.3,
    rounds: int = 12,
    progress: Progress | None = None,
) -> RestoredImage:
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
    start = total_variation(
        observation, iterations=_START, progress=progress.part(0, 0.1)
    ).period_image
    assert start is not None
    white = max(
        float(torch.quantile(_subsample(observation.crop_to_frame(start)), _WHITE)),
        observation.scale,
    )
    left = _RemainingNoise.of(observation, white)
    # Where next to no noise is left, the data need no help.
    tightest = min(left.penalty_for(_MIN_LEVEL), strength)
    loosest = min(left.penalty_for(_FIRST_LEVEL), tightest)
    penalties = torch.logspace(math.log10(loosest), math.log10(tightest), rounds).tolist()
    equations = NormalEquations(observation)
    picture, spectrum, change = start, rfft2(start - equations.mean), list[float]()
    for number, penalty in enumerate(penalties):
        progress.report(0.1 + 0.9 * number / rounds, f"plug-and-play {number + 1}/{rounds}")
        level = max(left.denoiser_level(penalty), _MIN_LEVEL)
        wanted = denoise(picture / white, level).mul_(white).clamp_(min=0)
        if observation.support is not None:
            wanted.mul_(observation.support)
        near = rfft2(wanted - equations.mean)
        everywhere = torch.full_like(observation.squared_mtf, penalty)
        spectrum, _ = equations.solve(everywhere, spectrum, _STEPS, near)
        before, picture = picture, equations.picture(spectrum)
        change.append(relative_change(picture, before))
    return RestoredImage(
        observation.crop_to_frame(picture).clamp(min=0),
        "plug-and-play",
        observation.noise,
        equations.residual(spectrum),
        strength,
        rounds,
        change,
        period_image=picture,
    )


@dataclass(frozen=True, eq=False)
class _RemainingNoise:
    """The noise in the x of the least |H x - y|² + K |x - z|², relative to white.

    noise: of the photograph. power, count: |H|² of each frequency, and for how many it stands.
    """

    noise: float
    power: torch.Tensor
    count: torch.Tensor

    @classmethod
    def of(cls, observation: Observation, white: float) -> _RemainingNoise:
        every = max(1, math.isqrt(observation.squared_mtf.numel() // _SAMPLED_FREQUENCIES))
        count = rfft_column_weights(observation.period_shape[1])[::every].expand(
            observation.squared_mtf[::every, ::every].shape
        )
        return cls(
            observation.scene_noise / white,
            observation.squared_mtf[::every, ::every].double(),
            count.double(),
        )

    def denoiser_level(self, penalty: float) -> float:
        """The level that the denoiser is told for a K."""
        squares = self.power / (self.power + penalty).square() * self.count
        mean = math.sqrt(float(squares.sum() / self.count.sum()))
        worst = 0.5 / math.sqrt(penalty)
        return (
            _LEVEL_FACTOR
            * self.noise
            * mean ** (1 - _WORST_FREQUENCY_SHARE)
            * worst**_WORST_FREQUENCY_SHARE
        )

    def penalty_for(self, level: float) -> float:
        """The K for which that is the level, or the loosest: by bisection in logarithms."""
        low, high = math.log(_MIN_PENALTY), math.log(1e3)
        for _ in range(40):
            middle = 0.5 * (low + high)
            low, high = (
                (middle, high) if self.denoiser_level(math.exp(middle)) > level else (low, middle)
            )
        return math.exp(high)


def _subsample(picture: torch.Tensor) -> torch.Tensor:
    """Of large pictures not every value, for statistics."""
    return picture.flatten()[:: max(1, picture.numel() >> 18)]


def _solve(
    observation: Observation,
    weight: float | None,
    *,
    iterations: int,
    progress: Progress,
    denoise: Denoise | None = None,
) -> RestoredImage:
    if denoise is None:
        raise ValueError("method is plug-and-play, and no denoiser is given; give one")
    chosen = {} if weight is None else {"strength": weight}
    return plug_and_play(observation, denoise, rounds=iterations, progress=progress, **chosen)


_MULTIPLY_ADDS_PER_PIXEL = 4.4e4
"""Multiplications and additions of the denoiser, a pixel."""


def _round_cost(observation: Observation) -> RestorationCost:
    """A denoised picture, and where part of the period was seen, conjugate gradients."""
    network = RestorationCost(2, 100, 1.4 * _MULTIPLY_ADDS_PER_PIXEL)
    return network if observation.is_fully_measured else network.plus(RestorationCost(12, 150))


METHOD = RestorationMethod(
    "a learned denoiser for a prior",
    _solve, {8: 4.6, 12: 5.0}, 12, SETUP_COST.plus(RestorationCost(60, 800)), _round_cost,
    needs_denoiser=True,
)  # fmt: skip
