"""The two planes of a Fourier integral, and the phase between their samples."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from optics.plane import Plane, RectilinearGrid


def unit_phasor(turns: torch.Tensor, dtype: torch.dtype) -> torch.Tensor:
    """exp(2 pi i turns) in `dtype`, from float64 turns reduced to within half a turn."""
    angle = 2 * math.pi * (turns - torch.round(turns.detach()))
    return torch.polar(torch.ones_like(angle), angle).to(dtype)


@dataclass(frozen=True)
class FourierGeometry:
    """Two planes and the product wavelength times distance, in square metres.

    A pupil of unevenly spaced rows and columns has no step: matrix and gridded transforms
    alone serve it.
    """

    pupil: Plane | RectilinearGrid
    image: Plane
    scale: float

    def __post_init__(self) -> None:
        if not 0 < self.scale < math.inf:
            raise ValueError(
                f"scale {self.scale} m² (wavelength x distance) must be positive and finite"
            )

    def step(self, axis: int) -> float:
        """Turns of phase per pupil sample and image sample."""
        if isinstance(self.pupil, RectilinearGrid):
            raise ValueError("a pupil of uneven rows has no step; use the gridded transform")
        return self.pupil.pitch[axis] * self.image.pitch[axis] / self.scale

    def pupil_offsets(self, axis: int) -> torch.Tensor:
        """Metres of the pupil's samples from its centre along an axis, float64."""
        return self.pupil.coordinates(axis) - self.pupil.centre[axis]

    def pupil_tilt(self, axis: int, dtype: torch.dtype) -> torch.Tensor | None:
        """The phase over the pupil that an off-centre image asks for; None if it's centred."""
        centre = self.image.centre[axis]
        if centre == 0:
            return None
        return unit_phasor(-self.pupil_offsets(axis) * centre / self.scale, dtype)

    def image_tilt(self, axis: int, dtype: torch.dtype) -> torch.Tensor | None:
        """The phase over the image that an off-centre pupil leaves; None if it's centred."""
        centre = self.pupil.centre[axis]
        if centre == 0:
            return None
        return unit_phasor(-self.image.coordinates(axis) * centre / self.scale, dtype)
