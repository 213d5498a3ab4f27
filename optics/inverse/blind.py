"""Find a photograph's unknown blur kernel: the likeliest over all sharp pictures.

The search starts from kernels by strong edges. Parts of the photograph and a second search tell the
kernel's uncertainty.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import EllipsisType

import torch

from optics.fourier import irfft2, rfft2
from optics.inverse.gradient_statistics import (
    LIGHT_DEVIATION,
    NATURAL_GRADIENTS,
    GaussianMixture,
    gradients,
)
from optics.inverse.kernel_search import (
    EDGE_PENALTIES,
    NormalisedPhotograph,
    QuadraticProblem,
    align_kernel,
    centred_window_start,
    cut_window,
    fast_period,
    least_squares_problem,
    minimise_nonnegative,
    next_odd,
    padded_spectrum,
    search_kernel_by_edges,
    without_specks,
)
from optics.inverse.normal_equations import conjugate_gradients
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

# Side of the window in which a kernel is estimated, over the requested size, so that the kernel
# may shift. Chosen.
_SIZE_SLACK = 1.15

# Share of the kernel's peak below which its pixels are set to 0, and share of its light below
# which connected parts are removed. Chosen.
_SPECK = 0.02

_MIN_FRAME_SIDES = 3  # smallest side of the photograph, relative to the kernel's; chosen

# Starts from which a kernel is refined, and rounds of the refinement for a part of the
# photograph. Chosen.
_STARTS, _PART_ROUNDS = 2, 10

# Factor by which the mean of two kernels must lower the unnaturalness to be used. Chosen.
_MIN_IMPROVEMENT = 1.01

# Smallest standard deviation of the photograph over that of the noise, and the largest share of
# clipped pixels. Chosen.
_MIN_CONTRAST_TO_NOISE, _MAX_CLIPPED_SHARE = 3.0, 0.5

# First noise of the search by statistics, over the photograph's, and the smallest standard
# deviation of the noise, which allows for errors of the model. Chosen.
_FIRST_NOISE, _MIN_NOISE = 2.0, 1e-3

# First rounds of the search by statistics, in which the kernel doesn't change, and the weight of
# the earlier samples in each round. Chosen.
_BURN_IN_ROUNDS, _HISTORY_WEIGHT = 2, 0.75


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
        """The score in words: good if the error isn't much larger than the noise, fair or poor."""
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
    al. 2011, doi 10.1109/CVPR.2011.5995308), with samples of a fixed seed: see LatentImageSampler.
    The difference of the results from two starts shows how reliable they are. See thesis Fig. 2.9
    f, g.

    Raises ValueError if the photograph has no structure, is smaller than three kernels, isn't
    finite or is mostly clipped, or if another argument is outside its range.

    image: light per pixel on any scale, (rows, columns); each side at least 3 times `size`.
    size: largest side of the kernel in pixels, 3 or more; best a little more than that of the blur.
    noise: standard deviation of a pixel; estimated if None.
    clipped: True where the well was full, in at most half of the pixels; these aren't used.
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


def refine_kernel_by_statistics(
    photo: NormalisedPhotograph, start: torch.Tensor, progress: Progress, rounds: int = 20
) -> torch.Tensor:
    """Find the likeliest kernel over all sharp pictures that natural statistics allow.

    The algorithm is stochastic expectation maximisation (Delyon, Lavielle and Moulines 1999, doi
    10.1214/aos/1018031103). The assumed noise decreases to the photograph's in the last round.
    """
    size = start.shape[0], start.shape[1]
    latent = LatentImageSampler(photo.image, photo.valid, NATURAL_GRADIENTS, size, seed=0)
    kernel, noise = start, max(photo.noise, _MIN_NOISE)
    told: QuadraticProblem | None = None
    for number in range(rounds):
        progress.report(number / rounds, f"natural statistics {number + 1}/{rounds}")
        factor = _FIRST_NOISE ** (1 - number / (rounds - 1))
        latent.sample(kernel, noise * factor)
        now = latent.kernel_problem(kernel)
        if told is not None:
            now = QuadraticProblem(
                torch.lerp(now.normal_matrix, told.normal_matrix, _HISTORY_WEIGHT),
                torch.lerp(now.right_hand_side, told.right_hand_side, _HISTORY_WEIGHT),
            )
        told = now
        if number >= _BURN_IN_ROUNDS:
            kernel = minimise_nonnegative(told, kernel, sum_is_one=True)
    return kernel


_PARTS = 2  # number of parts into which the photograph is divided along each axis


def kernel_deviation(
    photo: NormalisedPhotograph,
    kernel: torch.Tensor,
    rival: torch.Tensor,
    refine: Callable[[NormalisedPhotograph, torch.Tensor, Progress], torch.Tensor],
    progress: Progress,
) -> torch.Tensor:
    """Estimate the standard deviation of each pixel of a kernel.

    `refine` estimates the kernel again from parts of the photograph that share no pixel. The
    variance of the mean of these kernels is their variance over their number. `rival` was found
    from another start; its difference from the kernel shows whether the search has converged, which
    the parts can't show (Gelman and Rubin 1992, doi 10.1214/ss/1177011136).
    """
    rows, columns = photo.image.shape
    square = torch.zeros_like(kernel)
    for number in range(_PARTS**2):
        y, x = divmod(number, _PARTS)
        inside = (
            slice(rows * y // _PARTS, rows * (y + 1) // _PARTS),
            slice(columns * x // _PARTS, columns * (x + 1) // _PARTS),
        )
        part = NormalisedPhotograph(photo.image[inside], photo.valid[inside], photo.noise)
        told = progress.part(number / _PARTS**2, (number + 1) / _PARTS**2)
        square += (align_kernel(refine(part, kernel, told), kernel) - kernel).square()
    # The factor of 2 in the deviation allows for the error that all parts share. It was measured on
    # photographs with known kernels.
    spread = 2.0**2 * square / _PARTS**2 / (_PARTS**2 - 1)
    spread = spread + (align_kernel(rival, kernel) - kernel).square()
    # Neighbouring pixels of the kernel are taken to have similar variances.
    pooled = torch.nn.functional.avg_pool2d(spread[None, None], 3, 1, 1)[0, 0]
    return pooled.sqrt()


class LatentImageSampler:
    """Samples the posterior distribution of the sharp picture for a given blur kernel.

    It is a Gibbs sampler (Schmidt, Gao and Roth 2010, doi 10.1109/CVPR.2010.5539844). In turn, it
    draws the component of the Gaussian mixture to which each gradient belongs, and the picture for
    these components: exactly, by a linear solve with noise added to data and prior (Papandreou and
    Yuille 2010). Variational Bayes, with an independent normal posterior for each pixel,
    overestimates the uncertainty of wide kernels; with noise, it prefers a point to the true blur.

    The picture includes the surroundings from which light reaches the frame, so that nothing is
    assumed about the border.

    valid: 1 where a pixel may be used, else 0, (rows, columns).
    size: (rows, columns) of the kernels.
    """

    def __init__(
        self,
        image: torch.Tensor,
        valid: torch.Tensor,
        prior: GaussianMixture,
        size: tuple[int, int],
        seed: int,
    ) -> None:
        self._image, self._valid = image - image.mean(), valid
        self._prior, self._size = prior, size
        self._deviations = image.new_tensor(prior.deviations)
        self._generator = torch.Generator().manual_seed(seed)
        rows, columns = image.shape
        self._field_shape = rows + size[0] - 1, columns + size[1] - 1
        self._period = fast_period(
            self._field_shape[0] + size[0] - 1, self._field_shape[1] + size[1] - 1
        )
        self._frame_slices = self._slices_from_first(rows, columns)
        whole = image.new_zeros(self._period)
        whole[self._frame_slices] = valid
        self._valid_spectrum = rfft2(whole)
        y, x = size[0] // 2, size[1] // 2
        around = (x, size[1] - 1 - x, y, size[0] - 1 - y)
        middle = self._image[None, None]
        self.picture = torch.nn.functional.pad(middle, around, mode="replicate")[0, 0]

    def sample(self, kernel: torch.Tensor, deviation: float) -> None:
        """Draw the next sharp picture, for a kernel and the noise's standard deviation."""
        along, down = _differences(self.picture)
        along, down = self._sample_precisions(along), self._sample_precisions(down)
        self.picture = self.sample_picture(kernel, deviation, along, down)

    def sample_picture(
        self, kernel: torch.Tensor, deviation: float, along: torch.Tensor, down: torch.Tensor
    ) -> torch.Tensor:
        """Draw the sharp picture for gradients along rows and down columns of known precisions."""
        period, precision, pad = self._period, deviation**-2, torch.nn.functional.pad
        spectrum = padded_spectrum(kernel, period)
        squares = padded_spectrum(kernel.square(), period)
        reached = irfft2(self._valid_spectrum * squares.conj(), period)
        told = reached[: self._field_shape[0], : self._field_shape[1]].clamp(min=0) * precision
        # The preconditioner has the precisions of the four gradients around each pixel.
        around = pad(along, (1, 0)) + pad(along, (0, 1))
        around = around + pad(down, (0, 0, 1, 0)) + pad(down, (0, 0, 0, 1))
        inverse = (told + around).reciprocal()
        noisy = (self._image + deviation * self._normal_noise(self._image)) * self._valid
        wanted = self._blur_adjoint(noisy, spectrum) * precision
        _add_adjoint(
            wanted, along.sqrt() * self._normal_noise(along), down.sqrt() * self._normal_noise(down)
        )

        def normal(x: torch.Tensor) -> torch.Tensor:
            light = irfft2(padded_spectrum(x, period) * spectrum, period)
            light = light[self._frame_slices] * self._valid
            answer = self._blur_adjoint(light, spectrum).mul_(precision)
            steps = _differences(x)
            _add_adjoint(answer, along * steps[0], down * steps[1])
            return answer

        left = wanted - normal(self.picture)
        # Conjugate gradients start from the last picture, reduce the squared residual by 1e-5, and
        # do at most 25 steps.
        enough = 1e-5 * _inner_product(left, left * inverse)
        picture, *_ = conjugate_gradients(
            normal, left, self.picture, inverse, _inner_product, enough, 25
        )
        return picture

    def kernel_problem(self, kernel: torch.Tensor) -> QuadraticProblem:
        """Return the least-squares problem for the kernel, from sharp and blurred gradients.

        Gradients that weren't measured are replaced by those of the picture blurred by `kernel`, so
        that each step is one of expectation maximisation.
        """
        spectrum = padded_spectrum(gradients(self.picture), self._period)
        light = irfft2(spectrum * padded_spectrum(kernel, self._period), self._period)
        known, seen = self._valid, gradients(self._image)
        trusted = known[:-1, :-1] * known[:-1, 1:] * known[1:, :-1] > 0
        frame = self._slices_from_first(seen.shape[1], seen.shape[2])
        light[frame] = torch.where(trusted, seen, light[frame])
        return least_squares_problem(spectrum, rfft2(light), self._size)

    def _sample_precisions(self, steps: torch.Tensor) -> torch.Tensor:
        """Draw the Gaussian of each gradient, and return its precision."""
        below = self._prior.log_joint(steps.square()).softmax(0).cumsum(0)
        drawn = torch.rand(steps.shape, generator=self._generator, dtype=steps.dtype)
        return self._deviations[(drawn > below[:-1]).sum(0)] ** -2

    def _normal_noise(self, like: torch.Tensor) -> torch.Tensor:
        return torch.randn(like.shape, generator=self._generator, dtype=like.dtype)

    def _slices_from_first(self, rows: int, columns: int) -> tuple[EllipsisType, slice, slice]:
        y, x = self._size[0] - 1, self._size[1] - 1
        return (..., slice(y, y + rows), slice(x, x + columns))

    def _blur_adjoint(self, light: torch.Tensor, spectrum: torch.Tensor) -> torch.Tensor:
        """Apply the adjoint of the blur to light in the frame."""
        whole = light.new_zeros(self._period)
        whole[self._frame_slices] = light
        back = irfft2(rfft2(whole) * spectrum.conj(), self._period)
        return back[: self._field_shape[0], : self._field_shape[1]]


def _differences(x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Compute the differences along rows, and those down columns."""
    return x[:, 1:] - x[:, :-1], x[1:] - x[:-1]


def _add_adjoint(x: torch.Tensor, along: torch.Tensor, down: torch.Tensor) -> None:
    """Add the adjoint of the differences to x in place."""
    x[:, 1:] += along
    x[:, :-1] -= along
    x[1:] += down
    x[:-1] -= down


def _inner_product(a: torch.Tensor, b: torch.Tensor) -> float:
    return float((a * b).sum())
