"""A denoising network in the place of a prior."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import torch
from torch import nn
from torch.nn import functional

from optics.fourier import rfft_column_weights
from optics.inverse.band_coupling import helmert_matrix, transform_bands
from optics.inverse.method import SETUP_COST, Denoise, Gain, RestorationCost, RestorationMethod
from optics.inverse.normal_equations import (
    ConjugateGradientStep,
    NormalEquations,
    squared_response,
)
from optics.inverse.observation import Observation
from optics.inverse.own_terms import in_own_unit
from optics.inverse.priors import Prior
from optics.inverse.restored_image import CONVERGED_CHANGE, RestoredImage
from optics.inverse.splitting import SplittingSettings, restored_image, solve_by_splitting
from optics.inverse.total_variation import METHOD as TOTAL_VARIATION
from optics.inverse.total_variation import total_variation
from optics.progress import Progress
from optics.threads import single_threaded
from optics.validation import require_count, require_positive

_MULTIPLE = 8  # the sides of the network's pictures must be multiples of this number of samples


class _ResidualBlock(nn.Module):
    """Two convolutions with a skip connection (He et al. 2016, doi 10.1109/CVPR.2016.90)."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(width, width, 3, padding=1, bias=False)
        self.second = nn.Conv2d(width, width, 3, padding=1, bias=False)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        answer: torch.Tensor = x + self.second(torch.relu(self.first(x)))
        return answer


def _blocks(width: int) -> nn.Sequential:
    """Build the two residual blocks of one resolution."""
    return nn.Sequential(*(_ResidualBlock(width) for _ in range(2)))


class Denoiser(nn.Module):
    """A neural network that removes white noise of a given level from grey pictures.

    It is a U-net (Ronneberger et al. 2015, doi 10.1007/978-3-319-24574-4_28) of residual blocks.
    The pictures are rearranged to four channels at half resolution, and a further channel holds
    the noise level (Zhang et al. 2018, doi 10.1109/TIP.2018.2839891). The network has no additive
    constants, so that a picture and a noise level that are twice as large give a result twice as
    large. Therefore it generalises to noise levels on which it wasn't trained (Mohan et al. 2020,
    arXiv 1906.05478).
    """

    def __init__(self) -> None:
        super().__init__()
        # Numbers of channels at a half, a quarter and an eighth of the picture's resolution.
        fine, middle, coarse = 32, 64, 96
        self.head = nn.Conv2d(5, fine, 3, padding=1, bias=False)
        self.fine_in = _blocks(fine)
        self.to_middle = nn.Conv2d(fine, middle, 2, 2, bias=False)
        self.middle_in = _blocks(middle)
        self.to_coarse = nn.Conv2d(middle, coarse, 2, 2, bias=False)
        self.coarse = _blocks(coarse)
        self.from_coarse = nn.ConvTranspose2d(coarse, middle, 2, 2, bias=False)
        self.middle_out = _blocks(middle)
        self.from_middle = nn.ConvTranspose2d(middle, fine, 2, 2, bias=False)
        self.fine_out = _blocks(fine)
        self.tail = nn.Conv2d(fine, 4, 3, padding=1, bias=False)
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def forward(self, pictures: torch.Tensor, level: torch.Tensor) -> torch.Tensor:
        """Denoise a batch, (pictures, 1, rows, columns), with sides that are multiples of 8.

        level: standard deviation of the noise: of each picture, (pictures,), or of each pixel.
        """
        folded = functional.pixel_unshuffle(pictures, 2)
        if level.ndim == 4:
            told = functional.avg_pool2d(level, 2)
        else:
            told = level[:, None, None, None].expand(-1, 1, *folded.shape[-2:])
        whole = torch.cat([folded, told], dim=1).contiguous(memory_format=torch.channels_last)
        head = self.head(whole)
        fine = self.fine_in(head)
        middle = self.middle_in(self.to_middle(fine))
        coarse = self.coarse(self.to_coarse(middle))
        middle = self.middle_out(self.from_coarse(coarse) + middle)
        fine = self.fine_out(self.from_middle(middle) + fine)
        return pictures - functional.pixel_shuffle(self.tail(fine + head), 2)

    @torch.no_grad()
    def denoise(
        self,
        picture: torch.Tensor,
        noise: float | torch.Tensor,
        axes: torch.Tensor | None = None,
    ) -> torch.Tensor:
        """Denoise the components of a picture of any size: see Denoise.

        Components of several bands are shifted and scaled to the range from 0 to 1, on which the
        network was trained.
        """
        rows, columns = picture.shape[-2:]
        bands = picture.reshape(-1, rows, columns)
        components = bands if axes is None else transform_bands(axes, bands)
        low, unit = torch.zeros(()), torch.ones(())
        if axes is not None:
            low = components.amin((-2, -1), keepdim=True).clamp_(max=0)
            unit = (components.amax((-2, -1), keepdim=True) - low).clamp_(min=1e-6)
        levels = (torch.as_tensor(noise).to(picture) / unit).expand_as(components)
        more = (0, -columns % _MULTIPLE, 0, -rows % _MULTIPLE)
        filled, told = (
            functional.pad(one[:, None].float(), more, mode="replicate")
            for one in ((components - low) / unit, levels)
        )
        # One component after the other takes less memory, and no more time.
        answer = torch.cat(
            [self(one[None], level[None]) for one, level in zip(filled, told, strict=True)]
        )
        found = answer[:, 0, :rows, :columns].to(picture) * unit + low
        return (found if axes is None else transform_bands(axes.mT, found)).reshape(picture.shape)


def load_denoiser(weights: Mapping[str, torch.Tensor]) -> Denoiser:
    """Build the denoiser with trained weights, for inference.

    Raises ValueError if a weight is missing, isn't expected, or has another shape.

    weights: by the keys of Denoiser.state_dict().
    """
    network = Denoiser()
    try:
        network.load_state_dict({name: value.to(torch.float32) for name, value in weights.items()})
    except RuntimeError as error:
        raise ValueError(f"weights don't fit the denoiser: {error}") from None
    return network.requires_grad_(False).eval()


# Noise level of the denoiser in the first round, and the smallest, relative to white. Chosen.
_FIRST_LEVEL, _MIN_LEVEL = 0.15, 0.002

# Factor between the denoiser's noise level and the noise that a linear step leaves, and the
# weight of the worst frequency in that noise. It is a geometric mean of the rms over all
# frequencies and of the noise at the worst one: some frequencies have far more noise than others,
# and a denoiser that gets the rms takes them for texture. Chosen.
_LEVEL_FACTOR, _WORST_SHARE = 1.3, 0.6

# Smallest penalty of the first round, relative to |H|² of a frequency without blur. Conjugate
# gradients take many steps with smaller ones where the PSF is wide and the border unknown.
# Chosen.
_MIN_PENALTY = 1e-4

# Steps of conjugate gradients in each round, which starts from the last one's result. Chosen.
_CG_STEPS = 6

# Share of the first picture in the result. Its errors are partly independent of the last one's.
# Measured for 44 photographs with 8 PSFs: with 0.2 to 0.3 none is below the first.
_FIRST_SHARE = 0.3

_WHITE_QUANTILE = 0.999  # quantile of a picture's light that counts as white; chosen


@single_threaded
@torch.no_grad()
@in_own_unit(centred=True)
def plug_and_play(
    observation: Observation,
    denoise: Denoise,
    *,
    strength: float = 0.3,
    rounds: int = 12,
    progress: Progress | None = None,
) -> RestoredImage:
    """Deblur a photograph with a denoiser in the place of a prior.

    The method is that of Venkatakrishnan et al. (2013, doi 10.1109/GlobalSIP.2013.6737048) with
    half-quadratic splitting (Zhang et al. 2021, doi 10.1109/TPAMI.2021.3088914). The first picture
    comes from total_variation(). Each round denoises the picture to z, and then computes the x that
    minimises |H x - y|² + K |x - z|², where the first term counts trusted pixels only. K grows
    geometrically up to `strength`, or less far for data with little noise. The result is a weighted
    mean of the first and the last picture, cut to be nowhere negative.

    Raises ValueError for a strength that isn't positive, or no round.

    denoise: denoiser of a picture with white at about 1.
    strength: largest K, relative to |H|² of a frequency without blur.
    rounds: number of rounds, 1 or more.
    """
    require_positive("strength", strength, "")
    require_count("rounds", rounds)
    progress = progress or Progress()
    # The scene beyond the frame has to be good from the start: the rounds hardly mend it.
    iterations = TOTAL_VARIATION.default_iterations(observation)
    first = total_variation(
        observation, iterations=iterations, progress=progress.part(0, 0.1)
    ).period_image
    start = first.reshape(-1, *observation.period_shape)
    step = ConjugateGradientStep(NormalEquations(observation, keeps_mean=True), _CG_STEPS, start)
    prior = _DenoisedPicture(observation, denoise, start, strength, rounds)
    solution = solve_by_splitting(
        step, [prior], SplittingSettings(rounds, strength, starts_from_picture=True),
        "plug-and-play", progress.part(0.1, 1), start,
    )  # fmt: skip
    blend = step.blend_with(start, _FIRST_SHARE)
    # The last round's coupling is the one whose solution is wanted.
    converged = solution.relative_changes[-1] <= CONVERGED_CHANGE
    return restored_image(step, replace(solution, picture=blend), "plug-and-play", converged)


class _DenoisedPicture(Prior):
    """The split picture, which a denoiser takes from the last one.

    The coupling K grows from round to round, and the denoiser's noise level falls with the noise
    that a linear step leaves in the picture.
    """

    def __init__(
        self,
        observation: Observation,
        denoise: Denoise,
        start: torch.Tensor,
        strength: float,
        rounds: int,
    ) -> None:
        light = observation.crop_to_frame(start)
        # About 2^18 values are enough.
        light = light.flatten()[:: max(1, light.numel() >> 18)]
        self._white = max(float(torch.quantile(light, _WHITE_QUANTILE)), observation.scale)
        response = squared_response(observation)
        # About 16,000 frequencies show the noise, each of which stands for some of the full FFT.
        every = max(1, math.isqrt(response.numel() // (1 << 14)))
        self._power = response[..., ::every, ::every].double()
        count = rfft_column_weights(observation.period_shape[1])[::every]
        self._count = count.double().expand(self._power.shape)
        self._noise = observation.disturbance / self._white
        # For data with hardly any noise, K stays small: the denoiser isn't needed.
        tightest = min(self._penalty_for(_MIN_LEVEL), strength)
        loosest = min(self._penalty_for(_FIRST_LEVEL), tightest)
        self._penalties = iter(
            torch.logspace(math.log10(loosest), math.log10(tightest), rounds).tolist()
        )
        self._observation, self._denoise = observation, denoise
        self.gram_spectrum = torch.ones(()).to(observation.image)

    def coupling(self, weight: float, data: float) -> float:
        return self._penalty

    def update(self, x: torch.Tensor, weight: float) -> None:
        self._penalty = next(self._penalties)
        level = max(self._denoiser_level(self._penalty), _MIN_LEVEL)
        noise = torch.full((len(x), 1, 1), level).to(x)
        axes = None if len(x) == 1 else helmert_matrix(len(x)).to(x)
        wanted = self._denoise(x / self._white, noise, axes).mul_(self._white).clamp_(min=0)
        support = self._observation.support
        self.adjoint_target = wanted if support is None else wanted.mul_(support)

    def _denoiser_level(self, penalty: float) -> float:
        """Return the denoiser's noise level, relative to white, for a penalty K."""
        squares = self._power / (self._power + penalty).square() * self._count
        mean = math.sqrt(float(squares.sum() / self._count.sum()))
        worst = 0.5 / math.sqrt(penalty)
        return _LEVEL_FACTOR * self._noise * mean ** (1 - _WORST_SHARE) * worst**_WORST_SHARE

    def _penalty_for(self, level: float) -> float:
        """Find the penalty K for the denoiser's noise level, but not below the smallest K."""
        low, high = math.log(_MIN_PENALTY), math.log(1e3)
        for _ in range(40):
            middle = 0.5 * (low + high)
            low, high = (
                (middle, high) if self._denoiser_level(math.exp(middle)) > level else (low, middle)
            )
        return math.exp(high)


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


def _round_cost(observation: Observation) -> RestorationCost:
    """Return the cost of one round with the denoiser.

    Conjugate gradients are included if part of the period wasn't measured.
    """
    # The denoiser takes 4.4e4 multiplications and additions per pixel.
    network = RestorationCost(2, 100, 1.4 * 4.4e4)
    return network if observation.is_fully_measured else network.plus(RestorationCost(12, 150))


METHOD = RestorationMethod(
    "a learned denoiser for a prior",
    _solve, {
        12: Gain(9.58, -1.25, 1.33, 1.36, 0.40, -0.64),
    }, 12, SETUP_COST.plus(RestorationCost(60, 800)), _round_cost,
    needs_denoiser=True,
    restores_bands=True,
)  # fmt: skip
