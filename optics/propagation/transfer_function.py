"""Transfer functions of free space, exact and paraxial, and their rays."""

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
    """Return the transfer function of free space for plane waves of frequencies (y, x), complex128.

    y, x: cycles per metre, float64; they broadcast. The factor exp(i k distance) is left out, so
    the phase of a wave is its difference from that of the axial wave,

        -2 pi z wavelength f² / (1 + sqrt(1 - (wavelength f)²)),

    which loses no digits at small angles. The paraxial phase is -pi wavelength z f² (sections 3.10
    and 4.2 of Goodman). Evanescent waves decay in both directions: backward propagation is the
    adjoint of forward propagation, so it never amplifies noise. The result is differentiable in
    both lengths. Its derivatives are finite at the grazing wave as well, where the exact derivative
    with respect to the wavelength is infinite.
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
    """Return the axial frequency of plane waves, cycles/m, float64; 0 for evanescent waves.

    y, x: the waves' lateral frequencies, cycles per metre.
    """
    f2 = y**2 + x**2
    if paraxial:
        return 1 / wavelength - wavelength * f2 / 2
    return _root(1 / wavelength**2 - f2)


def _root(square: torch.Tensor) -> torch.Tensor:
    """Return the square root of positive numbers, and 0, with derivative 0, for other numbers."""
    positive = square.detach() > 0
    return torch.where(positive, torch.sqrt(torch.where(positive, square, 1.0)), 0.0)


@dataclass(frozen=True)
class PlaneWaveRays:
    """The rays of plane waves: a ray of frequency f is displaced by X(f) = distance * tangent(f).

    wavelength: metres. Frequencies are plain numbers in cycles per metre.
    """

    wavelength: float
    paraxial: bool

    def tangent(self, frequency: float, across: float = 0.0) -> float:
        """Return the tangent of a plane wave's ray along an axis; infinite from grazing waves on.

        frequency, across: along this axis and along the other one, cycles per metre.
        """
        sine = self.wavelength * frequency
        if self.paraxial:
            return sine
        cosine2 = 1 - sine**2 - (self.wavelength * across) ** 2
        return sine / math.sqrt(cosine2) if cosine2 > 0 else math.copysign(math.inf, sine)

    def frequency(self, tangent: float, across: float = 0.0) -> float:
        """Return the frequency of the plane wave whose ray has a given tangent."""
        if self.paraxial:
            return tangent / self.wavelength
        cosine2 = max(1 - (self.wavelength * across) ** 2, 0.0)
        return tangent * math.sqrt(cosine2 / (1 + tangent**2)) / self.wavelength

    def ray_slope(self, frequency: float, distance: float) -> float:
        """Return the slope dX/df of a ray's displacement, m².

        It is a lower bound for waves with a frequency along the other axis.
        """
        flat = self.wavelength * abs(distance)
        if self.paraxial:
            return flat
        return flat / (1 - (self.wavelength * frequency) ** 2) ** 1.5

    @property
    def grazing_frequency(self) -> float:
        """The frequency from which waves are evanescent, cycles per metre."""
        return math.inf if self.paraxial else 1 / self.wavelength


def paraxial_phase_error(wavelength: float, distance: float, frequency: float) -> float:
    """Return the phase error in radians, or relative error, of the paraxial model at a frequency.

    It is the next term of the phase's series, pi / 4 wavelength³ ``|distance|`` f⁴ (section 4.2.1
    of Goodman).
    """
    return math.pi / 4 * wavelength**3 * abs(distance) * frequency**4
