"""The search for a blur kernel, first by strong edges, then by statistics of natural pictures."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from optics.deconvolution.blind.gradient_statistics import NATURAL_GRADIENTS
from optics.deconvolution.blind.latent_image import LatentImageSampler
from optics.deconvolution.blind.quadratic import QuadraticProblem, minimise_nonnegative
from optics.deconvolution.blind.scales import (
    centre_kernel,
    downsample,
    enlarge_kernel,
    next_odd,
    point_kernel,
    scale_factors,
)
from optics.deconvolution.blind.specks import without_specks
from optics.deconvolution.blind.strong_edges import StrongEdges
from optics.progress import Progress


@dataclass(frozen=True)
class EdgeSettings:
    """The penalties of the kernel search by strong edges.

    They are for photographs whose light has a standard deviation of LIGHT_DEVIATION. `weight` is
    the first penalty of each pixel with a gradient. `ridge` is the penalty of the kernel's squared
    norm.
    """

    weight: float
    ridge: float


EDGE_SETTINGS = (EdgeSettings(4e-3, 2.0), EdgeSettings(2e-2, 2.0), EdgeSettings(2e-2, 20.0))
"""Penalties from which the search by strong edges starts. Several are tried, since one doesn't suit
all photographs."""


@dataclass(frozen=True)
class KernelSearchSettings:
    """Tune the search for a blur kernel by strong edges and by statistics.

    All values are chosen.

    Attributes
    ----------
    weight_divisor : float
        Divisor of the edges' weight in each iteration.
    max_weight_division : float
        Largest divisor of the edges' weight over all scales.
    iterations_per_scale : int
        Iterations of the search by edges at each scale.
    speck_light_share : float
        Connected parts of the kernel with less than this share of its light are removed.
    initial_noise_factor : float
        First noise of the search by statistics, relative to the photograph's noise.
    burn_in_rounds : int
        First rounds of the search by statistics, in which the kernel doesn't change.
    history_weight : float
        Weight of the earlier samples in each round.
    seed : int
        Seed of the random samples.
    min_noise : float
        Smallest standard deviation of the noise, which allows for errors of the model.
    """

    weight_divisor: float = 1.1
    max_weight_division: float = 40.0
    iterations_per_scale: int = 5
    speck_light_share: float = 0.1
    initial_noise_factor: float = 2.0
    burn_in_rounds: int = 2
    history_weight: float = 0.75
    seed: int = 0
    min_noise: float = 1e-3


_SETTINGS = KernelSearchSettings()


@dataclass(frozen=True, eq=False)
class NormalisedPhotograph:
    """A photograph for the kernel search, scaled to a standard deviation of LIGHT_DEVIATION.

    `image` is (rows, columns). `valid` is 1 where a pixel may be used, else 0. `noise` is the
    standard deviation of a pixel.
    """

    image: torch.Tensor
    valid: torch.Tensor
    noise: float

    def downsample(self, factor: float) -> NormalisedPhotograph:
        """Shrink the photograph by a factor, for blind deconvolution at a coarser scale."""
        if factor == 1:
            return self
        known = (downsample(self.valid, factor) > 0.999).to(self.image)
        return NormalisedPhotograph(downsample(self.image, factor), known, self.noise / factor)

    def crop(self, rows: slice, columns: slice) -> NormalisedPhotograph:
        """Cut out a part of the photograph for blind deconvolution."""
        return NormalisedPhotograph(
            self.image[rows, columns], self.valid[rows, columns], self.noise
        )


def search_kernel_by_edges(
    photo: NormalisedPhotograph, size: int, settings: EdgeSettings, progress: Progress
) -> torch.Tensor:
    """Search for a photograph's blur kernel blindly by strong edges, from coarse to fine scales.

    The kernel is (size, size), and `size` is odd.
    """
    kernel, weight = point_kernel(3), settings.weight
    kernel[1, 0] = kernel[1, 1] = 0.5
    ladder = scale_factors(size)
    for number, factor in enumerate(ladder):
        progress.report(number / len(ladder), f"strong edges, 1/{factor:.3g} of the size")
        n = next_odd(size / factor)
        step = ladder[number - 1] / factor if number else 1.0
        kernel = enlarge_kernel(kernel, step, n)
        kernel = refine_kernel_by_edges(
            photo.downsample(factor), kernel, EdgeSettings(weight, settings.ridge), progress
        )
        weight = max(
            weight / _SETTINGS.weight_divisor**_SETTINGS.iterations_per_scale,
            settings.weight / _SETTINGS.max_weight_division,
        )
        kernel = centre_kernel(kernel, n)
    return kernel


def refine_kernel_by_edges(
    photo: NormalisedPhotograph, kernel: torch.Tensor, settings: EdgeSettings, progress: Progress
) -> torch.Tensor:
    """Improve a blindly estimated blur kernel by a photograph's strong edges, at one scale.

    The weight of the penalty on edges decreases from one iteration to the next.
    """
    weight = settings.weight
    strong = StrongEdges(photo.image, photo.valid, (kernel.shape[0], kernel.shape[1]))
    for _ in range(_SETTINGS.iterations_per_scale):
        progress.raise_if_cancelled()
        picture = strong.estimate_picture(kernel, weight)
        kernel = strong.estimate_kernel(picture, kernel, settings.ridge)
        kernel = without_specks(kernel, 0.0, _SETTINGS.speck_light_share)
        weight /= _SETTINGS.weight_divisor
    return kernel


def refine_kernel_by_statistics(
    photo: NormalisedPhotograph, start: torch.Tensor, progress: Progress, rounds: int = 20
) -> torch.Tensor:
    """Improve a blindly estimated blur kernel by the statistics of natural sharp pictures.

    The result is the likeliest kernel over all sharp pictures, at the finest scale. The algorithm
    is stochastic expectation maximisation (Delyon, Lavielle and Moulines 1999, doi
    10.1214/aos/1018031103), with samples from a fixed seed. The assumed noise decreases to the
    photograph's noise in the last of the `rounds`.
    """
    size = start.shape[0], start.shape[1]
    latent = LatentImageSampler(photo.image, photo.valid, NATURAL_GRADIENTS, size, _SETTINGS.seed)
    kernel, noise = start, max(photo.noise, _SETTINGS.min_noise)
    told: QuadraticProblem | None = None
    for number in range(rounds):
        progress.report(number / rounds, f"natural statistics {number + 1}/{rounds}")
        factor = _SETTINGS.initial_noise_factor ** (1 - number / (rounds - 1))
        latent.sample(kernel, noise * factor)
        now = latent.kernel_problem(kernel)
        told = now if told is None else told.blend_with(_SETTINGS.history_weight, now)
        if number >= _SETTINGS.burn_in_rounds:
            kernel = minimise_nonnegative(told, kernel, sum_is_one=True)
    return kernel
