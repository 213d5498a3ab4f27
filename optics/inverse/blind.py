"""Find a photograph's unknown blur kernel."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch

from optics.inverse.gradient_statistics import LIGHT_DEVIATION, gradients
from optics.inverse.kernel_search import (
    EDGE_PENALTIES,
    NormalisedPhotograph,
    align_kernel,
    centred_window_start,
    cut_window,
    kernel_deviation,
    next_odd,
    refine_kernel_by_statistics,
    search_kernel_by_edges,
    without_specks,
)
from optics.inverse.observation import LEAST_NOISE
from optics.inverse.observation_builder import build_observation
from optics.inverse.total_variation import total_variation
from optics.progress import Progress
from optics.threads import single_threaded
from optics.validation import accepts_numpy, as_floating_point, require_finite, require_same_shape

GOOD, FAIR = 0.9, 0.7
"""Scores from which a kernel may be used without a check, and after a look at the picture."""

MOST_ERROR = math.sqrt(10)
"""Kernel error and noise over the noise, up to which a kernel may be used without a check."""

_SIZE_SLACK = 1.15
"""Side of the window in which a kernel is estimated, over the requested size, so that the kernel
may shift. Chosen."""

_SPECK = 0.02
"""Share of the kernel's peak below which its pixels are set to 0, and share of its light below
which connected parts are removed. Chosen."""

_MIN_FRAME_SIDES = 3
"""Smallest side of the photograph, relative to the kernel's. Chosen."""

_STARTS, _PART_ROUNDS = 2, 10
"""Starts from which a kernel is refined, and rounds of the refinement for a part of the photograph.
Chosen."""

_MIN_IMPROVEMENT = 1.01
"""Factor by which the mean of two kernels must lower the unnaturalness to be used. Chosen."""

_MIN_CONTRAST_TO_NOISE, _MAX_CLIPPED_SHARE = 3.0, 0.5
"""Smallest standard deviation of the photograph over that of the noise, and the largest share of
clipped pixels. Chosen."""


@dataclass(frozen=True, eq=False)
class KernelEstimate:
    """An estimated blur kernel with its standard deviation and score.

    psf: kernel, (size, size), origin at n // 2, nowhere negative, with a sum of 1. Its centroid is
        as near to the origin as `size` allows: the photograph doesn't show a shift of the scene.
    deviation: standard deviation of each pixel of the kernel, (size, size). It comes from the
        differences between parts of the photograph and between searches from two starts, and
        doesn't include an error that all of them share.
    noise: standard deviation of a pixel of the photograph.
    score: 1 less the ratio of the kernel's expected squared error to its energy, 0 to 1.
    error_to_noise: standard deviation of noise and kernel error together over that of the noise, as
        the photograph's spectrum shows them: see `Observation.disturbance`.
    """

    psf: torch.Tensor
    deviation: torch.Tensor
    noise: float
    score: float
    error_to_noise: float = 1.0

    @property
    def verdict(self) -> str:
        """The score in words: good, fair or poor.

        The kernel is good from a score of 0.9 if its error isn't much larger than the noise, fair
        from 0.7, and poor below.
        """
        if self.score >= GOOD and self.error_to_noise <= MOST_ERROR:
            return "good: parts of the photograph and searches from two starts agree"
        if self.score >= FAIR:
            return (
                f"fair: its error weighs {self.error_to_noise:.1f} times as much as the noise; "
                "look for ringing in the restored picture"
            )
        return (
            "poor: parts of the photograph, or two searches, tell different kernels. Give a part "
            "with many sharp edges in all directions, or a smaller size"
        )


def _unnaturalness(photo: NormalisedPhotograph, kernel: torch.Tensor) -> float:
    """Measure how unnatural a photograph looks after it is deblurred with a kernel.

    The measure is the mean length of the picture's gradients over their rms. It is high for blurred
    edges, and for ringing by a wrong kernel (Krishnan, Tay and Fergus 2011, doi
    10.1109/CVPR.2011.5995521). It is multiplied by the factor by which the residual differs from
    the noise, since a wrong kernel adds false detail.
    """
    seen = build_observation(photo.image, kernel, photo.noise or None, clipped=photo.valid == 0)
    answer = total_variation(seen)
    # The unknown border affects a rim of half a kernel and 5 pixels, which is left out.
    rim = min(kernel.shape[0] // 2 + 5, min(answer.image.shape) // 4)
    inside = gradients(answer.image[rim:-rim, rim:-rim])
    size = float(inside.square().mean().sqrt())
    if size == 0:
        return math.inf
    left = max(answer.residual, 1e-3)
    return float(inside.abs().mean()) / size * max(left, 1 / left)


def find_kernel(
    image: torch.Tensor,
    size: int,
    *,
    noise: float | None = None,
    clipped: torch.Tensor | None = None,
    progress: Progress | None = None,
) -> KernelEstimate:
    """Estimate a photograph's blur kernel from the photograph alone.

    The kernel is taken to be the same everywhere. A first kernel comes from the strong edges of the
    photograph, from coarse to fine scales (Cho and Lee 2009, doi 10.1145/1618452.1618491; Xu, Zheng
    and Jia 2013). Then the likeliest kernel is estimated over all sharp pictures that the
    statistics of natural pictures allow (Fergus et al. 2006, doi 10.1145/1141911.1141956; Levin et
    al. 2011, doi 10.1109/CVPR.2011.5995308); these pictures are sampled: see LatentImageSampler.
    The estimation is done from two starts, and the difference of the results shows how reliable
    they are. The scene beyond the frame is unknown. The random samples have a fixed seed, so that
    the same photograph gives the same kernel. See thesis Fig. 2.9 f, g.

    Raises ValueError if the photograph has no structure, is smaller than three kernels, isn't
    finite or is mostly clipped, or if another argument is outside its range.

    image: light per pixel on any scale, (rows, columns); each side at least 3 times `size`.
    size: largest side of the kernel in pixels, 3 or more; best a little more than the size of the
        blur.
    noise: standard deviation of a pixel; estimated if None.
    clipped: True where the well was full, (rows, columns), in at most half of the pixels; these
        aren't used.
    """
    psf, deviation, level, score = _find_kernel(image, size, noise, clipped, progress or Progress())
    seen = build_observation(image, psf, clipped=clipped)
    ratio = seen.disturbance / seen.scene_noise
    return KernelEstimate(psf, deviation, level, score, ratio)


@accepts_numpy
@single_threaded
@torch.no_grad()
def _find_kernel(
    image: torch.Tensor,
    size: int,
    noise: float | None,
    clipped: torch.Tensor | None,
    progress: Progress,
) -> tuple[torch.Tensor, torch.Tensor, float, float]:
    """Return the kernel, its deviation, the noise and the score."""
    _require(image, size, noise, clipped)
    image = as_floating_point(image).to(torch.float64)
    known = torch.ones_like(image) if clipped is None else (~clipped.to(torch.bool)).to(image)
    level = estimate_photograph_noise(image, known) if noise is None else float(noise)
    light = image[known > 0]
    spread = float(light.std(correction=0))
    if spread <= max(_MIN_CONTRAST_TO_NOISE * level, LEAST_NOISE * float(light.abs().mean())):
        raise ValueError(
            f"image has a standard deviation of {spread:.3g}, with noise of {level:.3g}: it shows "
            "nothing that a blur could be told by; give a part with sharp edges, or more light"
        )
    scale = LIGHT_DEVIATION / spread
    shown = torch.where(known > 0, image, float(light.mean())) * scale
    photo = NormalisedPhotograph(shown.to(torch.float32), known.to(torch.float32), level * scale)
    wide = next_odd(_SIZE_SLACK * size)
    kernel, other = _most_natural_kernel(photo, wide, progress.part(0, 0.75))
    deviation = kernel_deviation(
        photo,
        kernel,
        other,
        lambda part, start, told: refine_kernel_by_statistics(part, start, told, _PART_ROUNDS),
        progress.part(0.75, 1),
    )
    first = centred_window_start(kernel, size)
    psf, unsure = cut_window(kernel, first, size), cut_window(deviation, first, size)
    psf = psf / psf.sum()
    score = 1 - float(unsure.square().sum() / psf.square().sum())
    return psf.to(image), unsure.to(image), level, min(max(score, 0.0), 1.0)


def _most_natural_kernel(
    photo: NormalisedPhotograph, size: int, progress: Progress
) -> tuple[torch.Tensor, torch.Tensor]:
    """Estimate two blur kernels from two starts, first the one whose picture looks more natural."""

    def rank(kernels: Sequence[torch.Tensor], told: Progress) -> list[int]:
        costs = []
        for number, kernel in enumerate(kernels):
            told.report(number / len(kernels), f"judging kernel {number + 1}/{len(kernels)}")
            costs.append(_unnaturalness(photo, kernel))
        return sorted(range(len(costs)), key=costs.__getitem__)

    starts, fine, count = [], [], len(EDGE_PENALTIES)
    for n, (weight, ridge) in enumerate(EDGE_PENALTIES):
        told = progress.part(0.4 * n / count, 0.4 * (n + 1) / count)
        found = search_kernel_by_edges(photo, size, weight, ridge, told)
        starts.append(without_specks(found, _SPECK, _SPECK))
    best = rank(starts, progress.part(0.4, 0.5))[:_STARTS]
    for n, start in enumerate(best):
        told = progress.part(0.5 + 0.2 * n, 0.5 + 0.2 * (n + 1))
        found = refine_kernel_by_statistics(photo, starts[start], told)
        fine.append(without_specks(found, _SPECK, _SPECK))
    chosen, other = rank(fine, progress.part(0.9, 0.95))
    # Where the errors of two kernels differ, their mean has a smaller error than either: the one
    # from strong edges, and the one from statistics.
    kernel, edges = fine[chosen], starts[best[chosen]]
    both = align_kernel(edges, kernel).clamp(min=0) + kernel
    mean = both / both.sum()
    progress.part(0.95, 1).report(0, "judging the mean kernel")
    if _MIN_IMPROVEMENT * _unnaturalness(photo, mean) < _unnaturalness(photo, kernel):
        kernel = mean
    return kernel, fine[other]


def estimate_photograph_noise(image: torch.Tensor, valid: torch.Tensor) -> float:
    """Estimate a blurred photograph's noise from its finest detail.

    The estimate is the median of the absolute diagonal detail, scaled for Gaussian noise (Donoho
    and Johnstone 1994, doi 10.1093/biomet/81.3.425).
    """
    detail = (image[:-1, :-1] - image[1:, :-1] - image[:-1, 1:] + image[1:, 1:]) / 2
    sound = (valid[:-1, :-1] * valid[1:, :-1] * valid[:-1, 1:] * valid[1:, 1:]) > 0
    return float(detail[sound].abs().median()) / 0.6745 if bool(sound.any()) else 0.0


def _require(
    image: torch.Tensor, size: int, noise: float | None, clipped: torch.Tensor | None
) -> None:
    """Raise ValueError for arguments from which no blur kernel can be found."""
    if image.ndim != 2:
        raise ValueError(f"image is {tuple(image.shape)}; give one band, (rows, columns)")
    require_finite("image", as_floating_point(image))
    if not (isinstance(size, int) and size >= 3):
        raise ValueError(f"size is {size!r}; give a whole number of pixels, 3 or more")
    sides = _MIN_FRAME_SIDES
    if min(image.shape) < sides * size:
        raise ValueError(
            f"image is {tuple(image.shape)} and size {size}; the photograph must be at least "
            f"{sides} kernels wide and high: give a size of at most "
            f"{min(image.shape) // sides}, or a larger part"
        )
    if noise is not None and not (noise >= 0 and math.isfinite(noise)):
        raise ValueError(f"noise is {noise:g}; it must be finite, and not negative")
    if clipped is None:
        return
    require_same_shape("image", image, clipped=clipped)
    share = float(clipped.to(torch.float64).mean())
    if share > _MAX_CLIPPED_SHARE:
        raise ValueError(
            f"{share:.0%} of the pixels are clipped; at most {_MAX_CLIPPED_SHARE:.0%} may "
            "be: expose for less time, or give a part that isn't burnt"
        )
