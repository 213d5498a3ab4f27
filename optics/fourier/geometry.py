"""The geometry of a Fourier transform: its two planes and the phase between their samples."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from optics.plane import Plane, RectilinearGrid


def unit_phasor(turns: torch.Tensor, dtype: torch.dtype) -> torch.Tensor:
    """Compute a Fourier phasor exp(2 pi i turns), with the phase reduced to half a turn.

    The reduction is done in float64.

    Parameters
    ----------
    turns : torch.Tensor
        Phase in turns, float64.
    dtype : torch.dtype
        complex64 or complex128.

    Returns
    -------
    torch.Tensor
        The phasor, in `dtype`, of the shape of `turns`.
    """
    angle = 2 * math.pi * (turns - torch.round(turns.detach()))
    real = dtype.to_real()
    return torch.complex(torch.cos(angle).to(real), torch.sin(angle).to(real))


@dataclass(frozen=True)
class FourierGeometry:
    """The two planes of a Fourier transform, and the product of wavelength and distance.

    A pupil with unevenly spaced rows and columns has no step. Only matrix and gridded transforms
    accept it.

    Parameters
    ----------
    pupil : Plane or RectilinearGrid
        Where the field is known.
    image : Plane
        Where its transform is computed.
    scale : float
        Wavelength times distance in square metres, positive.

    Raises
    ------
    ValueError
        For a scale that isn't positive and finite.
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
        """Compute the Fourier phase in turns per pupil sample and image sample along an axis.

        axis: 0 (y) or 1 (x).

        Raises
        ------
        ValueError
            For a pupil with unevenly spaced rows and columns.
        """
        if isinstance(self.pupil, RectilinearGrid):
            raise ValueError("a pupil of uneven rows has no step; use the gridded transform")
        return self.pupil.pitch[axis] * self.image.pitch[axis] / self.scale

    def pupil_offsets(self, axis: int) -> torch.Tensor:
        """Return the Fourier geometry's pupil positions relative to the pupil's centre, metres.

        The positions lie along an axis, 0 (y) or 1 (x), and are float64.
        """
        return self.pupil.coordinates(axis) - self.pupil.centre[axis]

    def pupil_tilt(self, axis: int, dtype: torch.dtype) -> torch.Tensor | None:
        """Compute the Fourier phase factor over the pupil for an image that is off-axis.

        The factor shifts the image to its off-axis centre.

        Parameters
        ----------
        axis : int
            0 (y) or 1 (x).
        dtype : torch.dtype
            complex64 or complex128.

        Returns
        -------
        torch.Tensor or None
            One phasor for each sample along the axis; None if the image is centred.
        """
        centre = self.image.centre[axis]
        if centre == 0:
            return None
        return unit_phasor(-self.pupil_offsets(axis) * centre / self.scale, dtype)

    def image_tilt(self, axis: int, dtype: torch.dtype) -> torch.Tensor | None:
        """Compute the Fourier phase factor over the image for a pupil that is off-axis.

        Parameters
        ----------
        axis : int
            0 (y) or 1 (x).
        dtype : torch.dtype
            complex64 or complex128.

        Returns
        -------
        torch.Tensor or None
            One phasor for each sample along the axis; None if the pupil is centred.
        """
        centre = self.pupil.centre[axis]
        if centre == 0:
            return None
        return unit_phasor(-self.image.coordinates(axis) * centre / self.scale, dtype)
