"""The transfer functions of free space, exact and paraxial, and the rays that they stand for."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from optics.fourier import unit_phasor
from optics.propagation.span import Scalar


def free_space_transfer_function(
    y: torch.Tensor,
    x: torch.Tensor,
    distance: Scalar,
    wavelength: Scalar,
    *,
    paraxial: bool = False,
) -> torch.Tensor:
    """What free space does to plane waves of frequencies (y, x), complex128.

    y, x: cycles per metre, float64; they broadcast. The factor exp(i k distance) is left out:
    the phase of a wave is that of its difference from the axial one,

        -2 pi z wavelength f² / (1 + sqrt(1 - (wavelength f)²)),

    which loses no digits at small angles; paraxial: -pi wavelength z f² (Goodman 3.10, 4.2).
    Evanescent waves die in both directions: going back is the adjoint of going forward, and
    never lets noise grow. Differentiable in both lengths, with finite derivatives at the
    grazing wave as well, whose own derivative in the wavelength is infinite.
    """
    f2 = y**2 + x**2
    if paraxial:
        return unit_phasor(-0.5 * distance * wavelength * f2, torch.complex128)
    cosine2 = 1 - wavelength**2 * f2
    travels = cosine2.detach() > 0
    waves = torch.where(travels, wavelength * f2, torch.ones_like(f2) / wavelength)
    phasor = unit_phasor(-distance * waves / (1 + _root(cosine2)), torch.complex128)
    if bool(travels.all()):
        return phasor
    return phasor * torch.exp(-2 * math.pi * abs(distance) / wavelength * _root(-cosine2))


def axial_frequency(
    y: torch.Tensor, x: torch.Tensor, wavelength: float, *, paraxial: bool = False
) -> torch.Tensor:
    """Cycles per metre along the axis of waves of frequencies (y, x), float64; those that
    don't travel have none."""
    f2 = y**2 + x**2
    if paraxial:
        return 1 / wavelength - wavelength * f2 / 2
    return _root(1 / wavelength**2 - f2)


def _root(square: torch.Tensor) -> torch.Tensor:
    """The square root of positive numbers, 0 of others; its derivative is 0 there, not NaN."""
    positive = square.detach() > 0
    return torch.where(positive, torch.sqrt(torch.where(positive, square, 1.0)), 0.0)


@dataclass(frozen=True)
class PlaneWaveRays:
    """Which way a wave goes: the ray of frequency f shifts by X(f) = distance times tangent(f).

    wavelength: metres. Frequencies in cycles per metre, all plain numbers.
    """

    wavelength: float
    paraxial: bool

    def tangent(self, frequency: float, across: float = 0.0) -> float:
        """Metres sideways a metre of distance; infinite for waves that graze or die.

        across: the frequency along the other axis.
        """
        sine = self.wavelength * frequency
        if self.paraxial:
            return sine
        cosine2 = 1 - sine**2 - (self.wavelength * across) ** 2
        return sine / math.sqrt(cosine2) if cosine2 > 0 else math.copysign(math.inf, sine)

    def frequency(self, tangent: float, across: float = 0.0) -> float:
        """Of the ray that goes so many metres sideways a metre."""
        if self.paraxial:
            return tangent / self.wavelength
        cosine2 = max(1 - (self.wavelength * across) ** 2, 0.0)
        return tangent * math.sqrt(cosine2 / (1 + tangent**2)) / self.wavelength

    def ray_slope(self, frequency: float, distance: float) -> float:
        """The slope dX/df at a frequency, square metres; never smaller off the other axis."""
        flat = self.wavelength * abs(distance)
        if self.paraxial:
            return flat
        return flat / (1 - (self.wavelength * frequency) ** 2) ** 1.5

    @property
    def grazing_frequency(self) -> float:
        """The frequency from which on waves don't travel."""
        return math.inf if self.paraxial else 1 / self.wavelength


def paraxial_phase_error(wavelength: float, distance: float, frequency: float) -> float:
    """Radians by which the paraxial phase of a wave is off, the next term of the series.

    pi / 4 wavelength³ |distance| f⁴ (Goodman 4.2.1); relative error of the field if small.
    """
    return math.pi / 4 * wavelength**3 * abs(distance) * frequency**4
