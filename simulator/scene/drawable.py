"""What a picture at an object can do: draw its sharp image as samples on the sensor plane."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import torch

from optics.formation import rfft2_frequencies, spectrum_of_samples
from optics.plane import Plane

Shift = tuple[float, float]
"""(y, x) metres on the object by which a picture has moved."""

STILL: Shift = (0.0, 0.0)


class Drawable(ABC):
    """A picture at an object, which appears upright on the sensor: y down, x to the right.

    The value 1 is white: all light of the picture's part of a target. In all methods
    `magnification` is metres on the sensor for a metre on the object.
    """

    has_exact_spectrum: ClassVar[bool] = False
    """Whether `spectrum` is free of aliasing, because it isn't computed from samples."""

    def extent(self, magnification: float, shift: Shift = STILL) -> tuple[float, float]:
        """Return the largest distance of a picture's light from the axis on the sensor.

        The distances along y and x are in metres; the default is infinite.
        """
        return math.inf, math.inf

    def spectral_decay(self, magnification: float, frequency: float) -> int:
        """Return the power of the frequency with which a picture's spectrum falls.

        frequency: lowest frequency that counts, cycles per metre on the sensor. The power is 1 for
        a picture with sharp edges.
        """
        return 1

    @abstractmethod
    def light(self, plane: Plane, magnification: float, shift: Shift = STILL) -> torch.Tensor:
        """Return the mean light over the cell around each sample of the sensor plane.

        The result is float32, (rows, columns), from 0 to 1. For one of several parts that add up
        to a target it may be negative.
        """

    def spectrum(self, plane: Plane, magnification: float, shift: Shift = STILL) -> torch.Tensor:
        """Return the Fourier spectrum on the plane's rfft2 grid, complex64.

        The origin is in the corner. The spectrum is divided by the transfer function of the
        average over cells. Frequencies beyond the plane's are aliased, but only after that average
        has reduced them.
        """
        spectrum = spectrum_of_samples(self.light(plane, magnification, shift))
        fy, fx = rfft2_frequencies(plane)
        spectrum /= torch.sinc(fy * plane.pitch[0]).to(torch.float32)
        spectrum /= torch.sinc(fx * plane.pitch[1]).to(torch.float32)
        return spectrum


@dataclass(frozen=True)
class UniformLight(Drawable):
    """Picture that has the same value everywhere and no edge.

    Parameters
    ----------
    value : float, default 1.0
        The value; 1 is white.
    """

    has_exact_spectrum = True
    value: float = 1.0

    def light(self, plane: Plane, magnification: float, shift: Shift = STILL) -> torch.Tensor:
        return torch.full(plane.shape, self.value)

    def spectrum(self, plane: Plane, magnification: float, shift: Shift = STILL) -> torch.Tensor:
        rows, columns = plane.shape
        spectrum = torch.zeros(rows, columns // 2 + 1, dtype=torch.complex64)
        spectrum[0, 0] = self.value * rows * columns
        return spectrum
