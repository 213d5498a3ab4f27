"""From a photograph to its kernel: first by strong edges, then by natural statistics."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from optics.deconvolution.blind.latent import Latent, Measured
from optics.deconvolution.blind.quadratic import least
from optics.deconvolution.blind.scales import centre_point, centred, factors, odd, resampled, shrunk
from optics.deconvolution.blind.specks import without_specks
from optics.deconvolution.blind.statistics import NATURAL, gradients
from optics.deconvolution.blind.strong_edges import StrongEdges
from optics.progress import Progress


@dataclass(frozen=True)
class Taste:
    """How strong edges are looked for, of light with a standard deviation of SPREAD.

    weight: of a pixel with a gradient, at first. ridge: of the kernel's energy, per squared
    gradient.
    """

    weight: float
    ridge: float


TASTES = (Taste(4e-3, 2.0), Taste(2e-2, 2.0), Taste(2e-2, 20.0))
"""That are tried: pictures differ more than one of them allows for."""

_LIGHTER, _LEAST_WEIGHT = 1.1, 40.0
"""What a weight is divided by each time, and in the end at most."""

_AT_EACH_SCALE = 5

_PART = 0.1
"""Of a kernel's light that a connected part must have, or it is a speck."""

_LOOSE, _ROUNDS = 2.0, 8
"""Of the noise that is first assumed, and rounds until it's the noise itself."""

_EXCESS = 1.0
"""Of the noise at the end: what the model doesn't know of makes it more than it is."""


@dataclass(frozen=True, eq=False)
class Photograph:
    """(rows, columns) with a standard deviation of SPREAD; known: 1 or 0; noise: standard deviation
    of a pixel."""

    image: torch.Tensor
    known: torch.Tensor
    noise: float

    def smaller(self, factor: float) -> Photograph:
        if factor == 1:
            return self
        known = (shrunk(self.known, factor) > 0.999).to(self.image)
        return Photograph(shrunk(self.image, factor), known, self.noise / factor)

    def part(self, rows: slice, columns: slice) -> Photograph:
        return Photograph(self.image[rows, columns], self.known[rows, columns], self.noise)

    @property
    def gradients(self) -> Measured:
        known = self.known
        trusted = known[:-1, :-1] * known[:-1, 1:] * known[1:, :-1]
        return Measured(gradients(self.image), trusted)


def by_edges(photo: Photograph, size: int, taste: Taste, progress: Progress) -> torch.Tensor:
    """From coarse to fine: a kernel of odd (size, size)."""
    kernel, weight = centre_point(3), taste.weight
    kernel[1, 0] = kernel[1, 1] = 0.5
    ladder = factors(size)
    for number, factor in enumerate(ladder):
        progress.report(number / len(ladder), f"strong edges, 1/{factor:.3g} of the size")
        n = odd(size / factor)
        step = ladder[number - 1] / factor if number else 1.0
        kernel = resampled(kernel, step, n)
        kernel = edges_at(photo.smaller(factor), kernel, Taste(weight, taste.ridge), progress)
        weight = max(weight / _LIGHTER**_AT_EACH_SCALE, taste.weight / _LEAST_WEIGHT)
        kernel = centred(kernel, n)
    return kernel


def edges_at(
    photo: Photograph, kernel: torch.Tensor, taste: Taste, progress: Progress
) -> torch.Tensor:
    """At one scale, from a kernel on, with ever smaller weights."""
    weight = taste.weight
    strong = StrongEdges(photo.image, photo.known, (kernel.shape[0], kernel.shape[1]))
    for _ in range(_AT_EACH_SCALE):
        progress.check()
        picture = strong.picture(kernel, weight)
        kernel = strong.kernel(picture, kernel, taste.ridge)
        kernel = without_specks(kernel, 0.0, _PART)
        weight /= _LIGHTER
    return kernel


def edges_again(
    photo: Photograph, kernel: torch.Tensor, progress: Progress, taste: Taste
) -> torch.Tensor:
    """At the finest scale, from a kernel near by, with the last of the weights."""
    return edges_at(photo, kernel, Taste(taste.weight / _LEAST_WEIGHT, taste.ridge), progress)


def by_statistics(photo: Photograph, start: torch.Tensor, progress: Progress) -> torch.Tensor:
    """At the finest scale, from a kernel near by: the likeliest one over all pictures."""
    latent = Latent(photo.gradients, NATURAL, (start.shape[0], start.shape[1]))
    kernel = start
    noise = _EXCESS * math.sqrt(2) * max(photo.noise, _LEAST_NOISE)
    for number in range(_ROUNDS):
        progress.report(number / _ROUNDS, f"natural statistics {number + 1}/{_ROUNDS}")
        latent.update(kernel, noise * _LOOSE ** (1 - number / (_ROUNDS - 1)))
        kernel = least(latent.problem(kernel), kernel, sum_is_one=True)
    return kernel


_LEAST_NOISE = 1e-3
"""Standard deviation, below which the model is no better than that."""
