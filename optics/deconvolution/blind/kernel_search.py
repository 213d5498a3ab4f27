"""From a photograph to its kernel: first by strong edges, then by natural statistics."""

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
    """How strong edges are looked for, of light with a standard deviation of SPREAD.

    weight: of a pixel with a gradient, at first. ridge: of the kernel's energy, per squared
    gradient.
    """

    weight: float
    ridge: float


EDGE_SETTINGS = (EdgeSettings(4e-3, 2.0), EdgeSettings(2e-2, 2.0), EdgeSettings(2e-2, 20.0))
"""That are tried: pictures differ more than one of them allows for."""

_WEIGHT_DIVISOR, _MAX_WEIGHT_DIVISION = 1.1, 40.0
"""What a weight is divided by each time, and in the end at most."""

_ITERATIONS_PER_SCALE = 5

_SPECK_LIGHT_SHARE = 0.1
"""Of a kernel's light that a connected part must have, or it is a speck."""

_INITIAL_NOISE_FACTOR, _ROUNDS, _BURN_IN_ROUNDS = 2.0, 20, 2
"""Of the noise that is first assumed, rounds until it's the noise itself, and the first of them,
which leave the kernel as it is."""

_HISTORY_WEIGHT, _SEED = 0.75, 0
"""Of what earlier samples tell, in each round; and of the samples."""

_LEAST_NOISE = 1e-3
"""Standard deviation, below which the model is no better than that."""


@dataclass(frozen=True, eq=False)
class NormalisedPhotograph:
    """(rows, columns) with a standard deviation of SPREAD; valid: 1 or 0; noise: standard deviation
    of a pixel."""

    image: torch.Tensor
    valid: torch.Tensor
    noise: float

    def downsample(self, factor: float) -> NormalisedPhotograph:
        if factor == 1:
            return self
        known = (downsample(self.valid, factor) > 0.999).to(self.image)
        return NormalisedPhotograph(downsample(self.image, factor), known, self.noise / factor)

    def crop(self, rows: slice, columns: slice) -> NormalisedPhotograph:
        return NormalisedPhotograph(
            self.image[rows, columns], self.valid[rows, columns], self.noise
        )


def search_kernel_by_edges(
    photo: NormalisedPhotograph, size: int, settings: EdgeSettings, progress: Progress
) -> torch.Tensor:
    """From coarse to fine: a kernel of odd (size, size)."""
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
            weight / _WEIGHT_DIVISOR**_ITERATIONS_PER_SCALE, settings.weight / _MAX_WEIGHT_DIVISION
        )
        kernel = centre_kernel(kernel, n)
    return kernel


def refine_kernel_by_edges(
    photo: NormalisedPhotograph, kernel: torch.Tensor, settings: EdgeSettings, progress: Progress
) -> torch.Tensor:
    """At one scale, from a kernel on, with ever smaller weights."""
    weight = settings.weight
    strong = StrongEdges(photo.image, photo.valid, (kernel.shape[0], kernel.shape[1]))
    for _ in range(_ITERATIONS_PER_SCALE):
        progress.raise_if_cancelled()
        picture = strong.estimate_picture(kernel, weight)
        kernel = strong.estimate_kernel(picture, kernel, settings.ridge)
        kernel = without_specks(kernel, 0.0, _SPECK_LIGHT_SHARE)
        weight /= _WEIGHT_DIVISOR
    return kernel


def refine_kernel_by_statistics(
    photo: NormalisedPhotograph, start: torch.Tensor, progress: Progress, rounds: int = _ROUNDS
) -> torch.Tensor:
    """At the finest scale, from a kernel near by: the likeliest one over all pictures, by
    stochastic expectation and maximisation (Delyon, Lavielle and Moulines 1999, doi
    10.1214/aos/1018031103), with samples from a seed that is always the same."""
    size = start.shape[0], start.shape[1]
    latent = LatentImageSampler(photo.image, photo.valid, NATURAL_GRADIENTS, size, _SEED)
    kernel, noise = start, max(photo.noise, _LEAST_NOISE)
    told: QuadraticProblem | None = None
    for number in range(rounds):
        progress.report(number / rounds, f"natural statistics {number + 1}/{rounds}")
        latent.sample(kernel, noise * _INITIAL_NOISE_FACTOR ** (1 - number / (rounds - 1)))
        now = latent.kernel_problem(kernel)
        told = now if told is None else told.blend_with(_HISTORY_WEIGHT, now)
        if number >= _BURN_IN_ROUNDS:
            kernel = minimise_nonnegative(told, kernel, sum_is_one=True)
    return kernel
