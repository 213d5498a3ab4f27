"""What every restoration says of itself: how it is asked for, what it gains, and its price."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

import torch

from optics.accuracy import MachineSpeed
from optics.deconvolution.observation import Observation
from optics.deconvolution.restored_image import RestoredImage
from optics.fourier.fft import fft_operations
from optics.progress import Progress

Denoise = Callable[[torch.Tensor, float], torch.Tensor]
"""Of a picture, (rows, columns) with white at about 1, and the standard deviation of its noise: the
picture without it."""


@dataclass(frozen=True)
class RestorationCost:
    """What a restoration does with the photograph, in the order of its time.

    transforms: two-dimensional FFTs of the whole period; passes: over all of its numbers.
    multiply_adds: a pixel of it. centre_passes: passes over the photograph's middle, for its
    spectrum.
    """

    transforms: float
    passes: float
    multiply_adds: float = 0.0
    centre_passes: float = 0.0

    def seconds(self, observation: Observation, speed: MachineSpeed) -> float:
        """Of one thread."""
        pixels = math.prod(observation.period_shape)
        number = 0.5 * fft_operations(pixels) * self.transforms * speed.fft
        number += pixels * (self.passes * speed.touch + self.multiply_adds * speed.multiply_add)
        if observation.image.dtype == torch.float64:
            number *= speed.double
        return 10 * speed.call + number + self.centre_passes * min(pixels, 1 << 18) * speed.touch

    def plus(self, other: RestorationCost, times: float = 1.0) -> RestorationCost:
        return RestorationCost(
            self.transforms + times * other.transforms,
            self.passes + times * other.passes,
            self.multiply_adds + times * other.multiply_adds,
            self.centre_passes + times * other.centre_passes,
        )


class Solve(Protocol):
    """How a restoration is asked for: weight by itself if None, so many iterations or rounds."""

    def __call__(
        self, observation: Observation, weight: float | None, *, iterations: int, progress: Progress
    ) -> RestoredImage: ...


@dataclass(frozen=True)
class RestorationMethod:
    """A way to restore a photograph.

    description: in a few words. gains: by its count of iterations or rounds, decibels that it gains
    over the blurred photograph. default_count: the count where nothing else is asked for.
    setup_cost, iteration_cost: work once, and in each iteration. needs_denoiser: whether `solve`
    takes a `denoise` as well.
    """

    description: str
    solve: Solve
    gains: Mapping[int, float]
    default_count: int
    setup_cost: RestorationCost
    iteration_cost: Callable[[Observation], RestorationCost]
    needs_denoiser: bool = False

    def seconds(self, observation: Observation, count: int, speed: MachineSpeed) -> float:
        """Predicted processor time."""
        return self.setup_cost.plus(self.iteration_cost(observation), count).seconds(
            observation, speed
        )


SETUP_COST = RestorationCost(5, 60, centre_passes=250)
"""The photograph's spectrum, noise and transfer function."""


def splitting_cost(observation: Observation) -> RestorationCost:
    """Of an iteration that splits off a gradient, and the light where part of it was seen."""
    return RestorationCost(2, 40) if observation.is_fully_measured else RestorationCost(4, 55)
