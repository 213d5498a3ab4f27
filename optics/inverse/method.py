"""What a method is: its function and cost, and its gain by noise, PSF and border."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import astuple, dataclass
from typing import Protocol

import torch

from optics.accuracy import MachineSpeed
from optics.fourier.fft import fft_operations
from optics.inverse.observation import Observation
from optics.inverse.restored_image import RestoredImage
from optics.progress import Progress


@dataclass(frozen=True)
class RestorationCase:
    """Features of a photograph on which a method's gain depends, each about 0 for an ordinary one.

    noise: decades of the noise over the picture's standard deviation, above 1/60; in half decades.
    size: octaves of the PSF's rms radius, above 6 pixels.
    explained: decades of the share of the data that the best linear filter explains, above a
        quarter; in 0.4 decades.
    transmission: decades of the mean squared MTF, above a sixteenth; in 0.4 decades.
    border: 1 if the scene goes on beyond the frame, 0 if not.
    """

    noise: float
    size: float
    explained: float
    transmission: float
    border: float

    @classmethod
    def of(cls, observation: Observation) -> RestorationCase:
        """Compute the features of a photograph."""
        observation = observation.in_own_unit
        share, _ = observation.power_law.wiener_prediction(*observation.squared_mtf_of_centre)
        explained = max(share, 1e-3)
        ratio = max(observation.disturbance / observation.scale, 1e-6)
        mean = max(float(observation.squared_mtf.detach().mean()), 1e-6)
        return cls(
            (math.log10(ratio) + 1.8) / 0.5,
            math.log2(max(observation.psf_radius, 0.5) / 6),
            (math.log10(explained) + 0.6) / 0.4,
            (math.log10(mean) + 1.2) / 0.4,
            float(observation.border == "unknown"),
        )


@dataclass(frozen=True)
class Gain:
    """A gain in PSNR over the blurred photograph, dB: `usual` where all features are 0.

    It is linear in the features of its case, see RestorationCase: the others are its change for 1.
    """

    usual: float
    by_noise: float
    by_size: float
    by_explained: float
    by_transmission: float
    by_border: float

    def predict(self, case: RestorationCase) -> float:
        """Predict the gain in PSNR over the blurred photograph, dB."""
        first, *slopes = astuple(self)
        return float(first + sum(a * b for a, b in zip(slopes, astuple(case), strict=True)))


def predicted_gain(gain: float | Gain, case: RestorationCase) -> float:
    """Return the gain in dB, whether it is a number or depends on the case."""
    return gain.predict(case) if isinstance(gain, Gain) else gain


class Denoise(Protocol):
    """A function that removes white noise from a picture.

    picture: (bands, rows, columns) with white at about 1, or (rows, columns).
    noise: standard deviation of the components' noise, a number or a map that broadcasts to them.
    axes: orthonormal matrix from bands to components, (bands, bands); they are the bands if None.
    """

    def __call__(
        self, picture: torch.Tensor, noise: float | torch.Tensor, axes: torch.Tensor | None = None
    ) -> torch.Tensor: ...


@dataclass(frozen=True)
class RestorationCost:
    """The operations of a method, from which its time is predicted.

    transforms: number of two-dimensional real FFTs of the whole period.
    passes: number of passes over all samples of the period.
    multiply_adds: number of multiplications and additions per pixel of the period.
    centre_passes: passes over the middle of the photograph, whose spectrum is computed.
    """

    transforms: float
    passes: float
    multiply_adds: float = 0.0
    centre_passes: float = 0.0

    def seconds(self, observation: Observation, speed: MachineSpeed) -> float:
        """Predict the seconds in one thread, for a photograph and a machine."""
        pixels = math.prod(observation.period_shape) * observation.bands
        number = 0.5 * fft_operations(pixels) * self.transforms * speed.fft
        number += pixels * (self.passes * speed.touch + self.multiply_adds * speed.multiply_add)
        if observation.image.dtype == torch.float64:
            number *= speed.double
        return 10 * speed.call + number + self.centre_passes * min(pixels, 1 << 18) * speed.touch

    def plus(self, other: RestorationCost, times: float = 1.0) -> RestorationCost:
        """Add `times` times another cost."""
        pairs = zip(astuple(self), astuple(other), strict=True)
        return RestorationCost(*(own + times * more for own, more in pairs))


class Solve(Protocol):
    """The function of a method, which chooses the regularisation weight itself if it is None."""

    def __call__(
        self, observation: Observation, weight: float | None, *, iterations: int, progress: Progress
    ) -> RestoredImage: ...


@dataclass(frozen=True)
class RestorationMethod:
    """A method that undoes blur, with its gain and its cost.

    description: the method in a few words.
    solve: the function that restores a photograph.
    gains: gain in PSNR over the blurred photograph in dB, by the number of iterations or rounds: a
        number, or one that depends on the case.
    default_count: default number of iterations or rounds.
    setup_cost: cost that occurs once.
    iteration_cost: cost of each iteration, for an observation.
    needs_denoiser: whether `solve` needs the argument `denoise` as well.
    slow_if_wide: whether twice the default number is needed where a wide PSF brings much light from
        beyond the frame.
    restores_bands: whether scenes of several bands, seen through a mosaic of filters, are restored.
    takes_variance: whether the photograph's variance map is used, not one noise for all pixels.
    """

    description: str
    solve: Solve
    gains: Mapping[int, float | Gain]
    default_count: int
    setup_cost: RestorationCost
    iteration_cost: Callable[[Observation], RestorationCost]
    needs_denoiser: bool = False
    slow_if_wide: bool = False
    restores_bands: bool = False
    takes_variance: bool = False

    def default_iterations(self, observation: Observation) -> int:
        """Return the number of iterations or rounds where none is asked for."""
        twice = self.slow_if_wide and observation.is_wide_beyond_frame
        return self.default_count * (2 if twice else 1)

    def seconds(self, observation: Observation, count: int, speed: MachineSpeed) -> float:
        """Predict the processor time in seconds with `count` iterations."""
        return self.setup_cost.plus(self.iteration_cost(observation), count).seconds(
            observation, speed
        )


SETUP_COST = RestorationCost(5, 60, centre_passes=250)
"""Cost of the photograph's spectrum, its noise and the transfer function."""


def splitting_cost(observation: Observation) -> RestorationCost:
    """Return the cost of one ADMM iteration with a split gradient, and often with split light."""
    return RestorationCost(2, 40) if observation.is_fully_measured else RestorationCost(4, 55)
