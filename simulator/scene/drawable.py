"""What can be drawn: the light of a picture, without any blur, on samples of the sensor plane."""

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
    """A picture at an object. It stands upright on the sensor: y down the rows, x to the right.

    magnification: metres on the sensor for a metre on the object. 1 is white: all of the light
    of its part of a target.
    """

    has_exact_spectrum: ClassVar[bool] = False
    """Whether its spectrum is that of the picture itself: nothing finer folds into it."""

    def extent(self, magnification: float, shift: Shift = STILL) -> tuple[float, float]:
        """How far from the axis it shines, (y, x) metres on the sensor, at most."""
        return math.inf, math.inf

    def spectral_decay(self, magnification: float, frequency: float) -> int:
        """With which power of the frequency its spectrum falls, from one on, in cycles per metre
        on the sensor: 1 where it has sharp edges."""
        return 1

    @abstractmethod
    def light(self, plane: Plane, magnification: float, shift: Shift = STILL) -> torch.Tensor:
        """Mean over the cell around each sample, (rows, columns) float32, 0 to 1.

        Of a part of a target it may be negative where others make up for it.
        """

    def spectrum(self, plane: Plane, magnification: float, shift: Shift = STILL) -> torch.Tensor:
        """On the plane's rfft2 grid, complex64, with the origin in the corner.

        That of the picture itself: what averaging over cells has taken is given back. Beyond the
        plane's frequencies there is nothing; what folds into them is left of it by the average.
        """
        spectrum = spectrum_of_samples(self.light(plane, magnification, shift))
        fy, fx = rfft2_frequencies(plane)
        spectrum /= torch.sinc(fy * plane.pitch[0]).to(torch.float32)
        spectrum /= torch.sinc(fx * plane.pitch[1]).to(torch.float32)
        return spectrum


@dataclass(frozen=True)
class UniformLight(Drawable):
    """The same everywhere, without an end."""

    has_exact_spectrum = True
    value: float = 1.0

    def light(self, plane: Plane, magnification: float, shift: Shift = STILL) -> torch.Tensor:
        return torch.full(plane.shape, self.value)

    def spectrum(self, plane: Plane, magnification: float, shift: Shift = STILL) -> torch.Tensor:
        rows, columns = plane.shape
        spectrum = torch.zeros(rows, columns // 2 + 1, dtype=torch.complex64)
        spectrum[0, 0] = self.value * rows * columns
        return spectrum
