"""Discs of light, among them an artificial star and a pinhole."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch

from optics.formation import rfft2_frequencies, spectrum_of_disc
from optics.plane import Plane
from optics.validation import require_positive, require_size
from simulator.scene.drawable import STILL, Drawable, Shift
from simulator.scene.polygons import polygon_coverage
from simulator.scene.target import Layer, Part, Target


@dataclass(frozen=True)
class Disc(Drawable):
    """Picture of an evenly lit disc.

    diameter, offset (y, x): metres on the object.
    """

    has_exact_spectrum = True
    diameter: float
    offset: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        require_positive("diameter", self.diameter, "m")
        require_size("object_size", "diameter", self.diameter)
        if not all(math.isfinite(part) for part in self.offset):
            raise ValueError(f"offset is {self.offset} m; it must be finite in each axis")

    def extent(self, magnification: float, shift: Shift = STILL) -> tuple[float, float]:
        size, y, x = self._diameter_and_centre(magnification, shift)
        return abs(y) + size / 2, abs(x) + size / 2

    def light(self, plane: Plane, magnification: float, shift: Shift = STILL) -> torch.Tensor:
        size, y, x = self._diameter_and_centre(magnification, shift)
        if not size:
            return torch.zeros(plane.shape)
        # A regular polygon of the same area replaces the circle. Its outline deviates from the
        # circle by at most 4e-5 of the radius.
        n = 360
        angles = np.arange(n) * (2 * np.pi / n)
        # A regular polygon's area is n r² sin(2π/n) / 2.
        radius = size / 2 * math.sqrt(2 * math.pi / (n * math.sin(2 * math.pi / n)))
        corners = np.stack([y + radius * np.sin(angles), x + radius * np.cos(angles)], axis=1)
        return torch.from_numpy(polygon_coverage(plane, [corners], [1.0]))

    def spectrum(self, plane: Plane, magnification: float, shift: Shift = STILL) -> torch.Tensor:
        """Return the Fourier spectrum: an exact jinc if the plane holds the disc.

        The spectrum of a disc that reaches beyond the plane is computed from samples.
        """
        size, y, x = self._diameter_and_centre(magnification, shift)
        halves = (n * pitch / 2 for n, pitch in zip(plane.shape, plane.pitch, strict=True))
        if any(abs(p) + size / 2 > half for p, half in zip((y, x), halves, strict=True)):
            return super().spectrum(plane, magnification, shift)
        samples = math.pi * size**2 / 4 / (plane.pitch[0] * plane.pitch[1])
        spectrum = spectrum_of_disc(plane, size, samples)
        if y or x:
            fy, fx = rfft2_frequencies(plane)
            turns = fy * y + fx * x
            spectrum = spectrum * torch.polar(torch.ones_like(turns), -2 * math.pi * turns)
        return spectrum.to(torch.complex64)

    def _diameter_and_centre(
        self, magnification: float, shift: Shift
    ) -> tuple[float, float, float]:
        """Return diameter and centre (y, x) on the sensor, in metres."""
        y, x = ((part + s) * magnification for part, s in zip(self.offset, shift, strict=True))
        return self.diameter * magnification, y, x


@dataclass(frozen=True)
class Star(Target):
    """Artificial star: an illuminated pinhole (thesis §3.4).

    Parameters
    ----------
    diameter, distance : float
        Of the pinhole, and from the panel, in metres, positive.
    radiance : float
        Spectral radiance of the pinhole, W / (sr m² m), not negative.
    offset : tuple of float, default (0.0, 0.0)
        Position (y, x) of the pinhole, metres on the object. The target appears upright.
    light, lamp, velocity, polarisation_angle, speckle, name : optional
        See `Target`.

    Raises
    ------
    ValueError
        If a length isn't positive, the radiance is negative, or an offset isn't finite.
    """

    diameter: float
    distance: float
    radiance: float
    offset: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        Disc(self.diameter, self.offset)

    @cached_property
    def layers(self) -> tuple[Layer, ...]:
        disc = Disc(self.diameter, self.offset)
        return (Layer(self.distance, (Part(self.reflected_radiance(), disc),)),)


@dataclass(frozen=True)
class Pinhole(Star):
    """Pinhole that is lit from behind through the filter (thesis §5.6).

    Parameters
    ----------
    diameter, distance, radiance : float, default 1e-3, 2.0, 1e9
        See `Star`.
    offset, light, lamp, velocity, polarisation_angle, speckle, name : optional
        See `Star`.
    """

    diameter: float = 1e-3
    distance: float = 2.0
    radiance: float = 1e9
