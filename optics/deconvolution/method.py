"""What every restoration says of itself: how it is asked for, what it gains, and its price."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

import torch

from optics.accuracy import MachineSpeed
from optics.deconvolution.blurred import Blurred
from optics.deconvolution.restored import Restored
from optics.fourier.fft import fft_operations
from optics.progress import Progress

Denoise = Callable[[torch.Tensor, float], torch.Tensor]
"""Of a picture, (rows, columns) with white at about 1, and the standard deviation of its noise: the
picture without it."""


@dataclass(frozen=True)
class Work:
    """What a restoration does with the photograph, in the order of its time.

    transforms: two-dimensional FFTs of the whole period; passes: over all of its numbers.
    multiply_adds: a pixel of it. middle: passes over the photograph's middle, for its spectrum.
    """

    transforms: float
    passes: float
    multiply_adds: float = 0.0
    middle: float = 0.0

    def seconds(self, seen: Blurred, speed: MachineSpeed) -> float:
        """Of one thread."""
        pixels = math.prod(seen.whole)
        number = 0.5 * fft_operations(pixels) * self.transforms * speed.fft
        number += pixels * (self.passes * speed.touch + self.multiply_adds * speed.multiply_add)
        if seen.image.dtype == torch.float64:
            number *= speed.double
        return 10 * speed.call + number + self.middle * min(pixels, 1 << 18) * speed.touch

    def plus(self, other: Work, times: float = 1.0) -> Work:
        return Work(
            self.transforms + times * other.transforms,
            self.passes + times * other.passes,
            self.multiply_adds + times * other.multiply_adds,
            self.middle + times * other.middle,
        )


class Solve(Protocol):
    """How a restoration is asked for: weight by itself if None, so many iterations or rounds."""

    def __call__(
        self, seen: Blurred, weight: float | None, *, iterations: int, progress: Progress
    ) -> Restored: ...


@dataclass(frozen=True)
class Method:
    """A way to restore a photograph.

    what: in a few words. gains: by its count of iterations or rounds, decibels that it gains over
    the blurred photograph. usual: the count where nothing else is asked for. before, each: work
    once, and in each iteration. learned: whether `solve` takes a `denoise` as well.
    """

    what: str
    solve: Solve
    gains: Mapping[int, float]
    usual: int
    before: Work
    each: Callable[[Blurred], Work]
    learned: bool = False

    def seconds(self, seen: Blurred, count: int, speed: MachineSpeed) -> float:
        """Predicted processor time."""
        return self.before.plus(self.each(seen), count).seconds(seen, speed)


PREPARED = Work(5, 60, middle=250)
"""The photograph's spectrum, noise and transfer function."""


def splitting_work(seen: Blurred) -> Work:
    """Of an iteration that splits off a gradient, and the light where part of it was seen."""
    return Work(2, 40) if seen.complete else Work(4, 55)
