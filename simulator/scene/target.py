"""What a target is made of: layers at distances, each of parts with a spectrum and a picture."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

from optics.camera import Camera
from optics.light.spectrum import Spectrum
from optics.light.waveform import Waveform
from simulator.scene.drawable import Drawable


def require_radiance(radiance: float) -> None:
    """Raise a ValueError for one that is negative or not finite."""
    if not 0 <= radiance < math.inf:
        raise ValueError(f"radiance is {radiance:g} W/(sr m² m); it must be finite, not negative")


def require_distance(distance: float) -> None:
    """Raise a ValueError for one that isn't in front of the camera; infinity is allowed."""
    if not distance > 0:
        raise ValueError(f"distance is {distance:g} m; it must be positive")


@dataclass(frozen=True, eq=False)
class Part:
    """A picture all of one spectrum.

    spectrum: radiance where the picture is 1, lamp and reflectance in it, W / (sr m² m).
    """

    spectrum: Spectrum
    picture: Drawable


@dataclass(frozen=True, eq=False)
class Layer:
    """What stands at one distance from the panel, in metres.

    parts: add up. cover: the share of what lies behind that it hides; None hides nothing.
    """

    distance: float
    parts: tuple[Part, ...]
    cover: Drawable | None = None


class _Stands(ABC):
    """What each kind of target has, as a field of its own.

    distance: metres from the panel, of the nearest layer. radiance: of white, where the lamp is
    brightest, W / (sr m² m).
    """

    distance: float
    radiance: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Target(_Stands):
    """Something that stands before the camera, in its light.

    light: the lamp's spectrum, relative; None is the same at all wavelengths. lamp: how it
    changes with time; None doesn't. velocity: (y, x) m/s across the axis, upright as the picture;
    an exposure begins with all in its place. polarisation_angle: radians, of the plane in which
    all of its light swings, from x towards y; None is unpolarised. name: what people call it.
    """

    light: Spectrum | None = None
    lamp: Waveform | None = None
    velocity: tuple[float, float] = (0.0, 0.0)
    polarisation_angle: float | None = None
    name: str = ""

    def __post_init__(self) -> None:
        require_distance(self.distance)
        require_radiance(self.radiance)
        if not all(math.isfinite(part) for part in self.velocity):
            raise ValueError(f"velocity is {self.velocity} m/s; it must be finite in each axis")
        if self.polarisation_angle is not None and not math.isfinite(self.polarisation_angle):
            raise ValueError(
                f"polarisation_angle is {self.polarisation_angle:g} rad; it must be finite"
            )

    @property
    @abstractmethod
    def layers(self) -> tuple[Layer, ...]:
        """The nearest first."""

    @property
    def is_moving(self) -> bool:
        return any(self.velocity)

    def for_camera(self, camera: Camera) -> Target:
        """The same, of a size that follows from the camera's frame where it has none itself.

        The same object for the same frame.
        """
        return self

    def reflected_radiance(self, reflectance: Spectrum | None = None) -> Spectrum:
        """Radiance of a matt surface of a reflectance, white by default, in the target's light."""
        lamp = (self.light or Spectrum.flat(1.0)).with_scale(self.radiance)
        return lamp if reflectance is None else lamp.times(reflectance)
