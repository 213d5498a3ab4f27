"""What stands before the camera: targets with distance, size and radiance."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import torch

from optics.camera import Camera
from optics.edge import require_finite, require_positive
from optics.formation import frequencies, spectrum_of_disc, spectrum_of_samples
from optics.plane import Plane, centred_crop, centred_pad

_PRIMARIES = (610e-9, 540e-9, 450e-9)
"""Wavelengths that the red, green and blue of a photograph stand for."""


def _require_radiance(radiance: float) -> None:
    if not 0 <= radiance < math.inf:
        raise ValueError(f"radiance is {radiance:g} W/(sr m² m); it must be finite, not negative")


@dataclass(frozen=True)
class Dark:
    """Nothing: the lamp is off."""

    distance: float = 2.0
    radiance: float = 0.0

    def spectrum(self, plane: Plane, camera: Camera, wavelength: float) -> torch.Tensor:
        return spectrum_of_samples(torch.zeros(plane.shape, dtype=torch.float64))


@dataclass(frozen=True)
class Star:
    """An artificial star: a lit pinhole (thesis §3.4).

    diameter, distance: metres. radiance: W / (sr m² m). offset: (y, x) metres from the axis to
    it; like a print it stands upright in the picture, y down the rows.
    """

    diameter: float
    distance: float
    radiance: float
    offset: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        require_positive("diameter", self.diameter, "m")
        require_positive("distance", self.distance, "m")
        _require_radiance(self.radiance)
        if not all(math.isfinite(part) for part in self.offset):
            raise ValueError(f"offset is {self.offset} m; it must be finite in each axis")

    def spectrum(self, plane: Plane, camera: Camera, wavelength: float) -> torch.Tensor:
        """Of its geometric image: a disc whose samples count one where it covers them.

        One that isn't wholly on the plane is too far off to be seen.
        """
        scale = camera.magnification(self.distance)
        size, (y, x) = self.diameter * scale, (part * scale for part in self.offset)
        samples = torch.pi * size**2 / 4 / (plane.pitch[0] * plane.pitch[1])
        spectrum = spectrum_of_disc(plane, size, samples)
        if not (y or x):
            return spectrum
        if not _holds(plane, y, x, size / 2):
            return torch.zeros_like(spectrum)
        fy, fx = frequencies(plane)
        turns = fy * y + fx * x
        return spectrum * torch.polar(torch.ones_like(turns), -2 * math.pi * turns)


def _holds(plane: Plane, y: float, x: float, reach: float) -> bool:
    """Whether what reaches so far around a point lies within a plane."""
    halves = (n * pitch / 2 for n, pitch in zip(plane.shape, plane.pitch, strict=True))
    return all(abs(p) + reach <= half for p, half in zip((y, x), halves, strict=True))


@dataclass(frozen=True)
class Flat:
    """An evenly lit field without an end: a diffuser that fills more than the frame.

    distance: metres; an even field has nothing to blur, but the blur is rendered, and is
    smallest in focus. radiance: W / (sr m² m).
    """

    distance: float
    radiance: float

    def __post_init__(self) -> None:
        require_positive("distance", self.distance, "m")
        _require_radiance(self.radiance)

    def spectrum(self, plane: Plane, camera: Camera, wavelength: float) -> torch.Tensor:
        """Of samples that are all one: white everywhere."""
        return spectrum_of_samples(torch.ones(plane.shape, dtype=torch.float64))


@dataclass(frozen=True)
class Photograph:
    """A flat, matt print across the axis, evenly lit.

    image: (rows, columns, 3), linear red, green and blue, 1 = white. distance: metres.
    radiance: of white, W / (sr m² m). cover: side of the print over side of the frame,
    where the print just covers it; what exceeds the frame lies beyond its edges.
    """

    image: torch.Tensor
    distance: float
    radiance: float
    cover: float = 1.05

    def __post_init__(self) -> None:
        if self.image.ndim != 3 or self.image.shape[2] != 3 or self.image.numel() == 0:
            raise ValueError(
                f"image is {tuple(self.image.shape)}; it needs rows, columns and 3 colours"
            )
        require_finite("image", self.image)
        require_positive("distance", self.distance, "m")
        require_positive("cover", self.cover, "")
        _require_radiance(self.radiance)

    def reflectance(self, wavelength: float) -> torch.Tensor:
        """The picture at a wavelength: interpolated between its three colours."""
        red, green, blue = _PRIMARIES
        position = min(max(wavelength, blue), red)
        if position >= green:
            share = (position - green) / (red - green)
            return (1 - share) * self.image[..., 1] + share * self.image[..., 0]
        share = (position - blue) / (green - blue)
        return (1 - share) * self.image[..., 2] + share * self.image[..., 1]

    def spectrum(self, plane: Plane, camera: Camera, wavelength: float) -> torch.Tensor:
        picture = self.reflectance(wavelength)
        sensor = camera.sensor
        scale = self.cover * max(
            n * sensor.pitch / (size * pitch)
            for n, size, pitch in zip(sensor.shape, picture.shape, plane.pitch, strict=True)
        )
        size = (round(picture.shape[0] * scale), round(picture.shape[1] * scale))
        shown = torch.nn.functional.interpolate(
            picture[None, None].to(torch.float64), size, mode="bicubic", antialias=scale < 1
        )[0, 0].clamp(0, 1)
        cropped = centred_crop(shown, (min(size[0], plane.shape[0]), min(size[1], plane.shape[1])))
        return spectrum_of_samples(centred_pad(cropped, plane.shape))


Target = Dark | Star | Flat | Photograph


@dataclass(frozen=True)
class Scene:
    """Named targets, of which one stands before the camera at a time."""

    targets: Mapping[str, Target] = field(default_factory=lambda: {"dark": Dark()})

    def __post_init__(self) -> None:
        if not self.targets:
            raise ValueError("targets is empty; a scene needs at least one")
