"""Scenes: targets by name, of layers at distances, of parts with a spectrum and a picture."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

from optics.camera import Camera
from optics.light.spectrum import Spectrum
from optics.light.waveform import Waveform
from optics.speckle import RoughSurface
from simulator.scene.drawable import Drawable, UniformLight


def require_distance(distance: float) -> None:
    """Raise ValueError for a distance that isn't positive; infinity is allowed."""
    if not distance > 0:
        raise ValueError(f"distance is {distance:g} m; it must be positive")


@dataclass(frozen=True, eq=False)
class Part:
    """Part of a depth layer: a picture with one spectrum.

    Parameters
    ----------
    spectrum : Spectrum
        Spectral radiance where the picture is 1, including lamp and reflectance, W / (sr m² m).
    picture : Drawable
        The picture by which the spectrum is multiplied.
    """

    spectrum: Spectrum
    picture: Drawable


@dataclass(frozen=True, eq=False)
class Layer:
    """Depth layer of a target: everything at one distance.

    Parameters
    ----------
    distance : float
        Distance from the panel in metres.
    parts : tuple of Part
        The parts of the layer, whose light adds up.
    cover : Drawable, optional
        Picture of the share of the light from behind that the layer hides; None hides nothing.
    """

    distance: float
    parts: tuple[Part, ...]
    cover: Drawable | None = None


class _Stands(ABC):
    """Declare the fields `distance` and `radiance`, which each kind of target defines.

    distance: of the nearest layer from the panel, metres. radiance: of white where the relative
    spectrum of the lamp is 1, W / (sr m² m).
    """

    distance: float
    radiance: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Target(_Stands):
    """Object that stands before the camera, with its illumination.

    Parameters
    ----------
    light : Spectrum, optional
        Relative spectrum of the lamp; None is the same at all wavelengths.
    lamp : Waveform, optional
        Change of the lamp's light with time; None is constant.
    velocity : tuple of float, default (0.0, 0.0)
        Velocity (y, x) across the axis in m/s, in the orientation of the picture. Each exposure
        begins with the target at its original position.
    polarisation_angle : float, optional
        Angle of linear polarisation in radians, from x towards y; None is unpolarised light.
    speckle : RoughSurface, optional
        Roughness of what scatters the light, which speckles; None doesn't.
    name : str, default ""
        Name of the target for people.

    Raises
    ------
    ValueError
        If the distance isn't positive, the radiance is negative, or a number isn't finite.
    """

    light: Spectrum | None = None
    lamp: Waveform | None = None
    velocity: tuple[float, float] = (0.0, 0.0)
    polarisation_angle: float | None = None
    speckle: RoughSurface | None = None
    name: str = ""

    def __post_init__(self) -> None:
        require_distance(self.distance)
        if not 0 <= self.radiance < math.inf:
            raise ValueError(
                f"radiance is {self.radiance:g} W/(sr m² m); it must be finite, not negative"
            )
        if not all(math.isfinite(part) for part in self.velocity):
            raise ValueError(f"velocity is {self.velocity} m/s; it must be finite in each axis")
        if self.polarisation_angle is not None and not math.isfinite(self.polarisation_angle):
            raise ValueError(
                f"polarisation_angle is {self.polarisation_angle:g} rad; it must be finite"
            )

    @property
    @abstractmethod
    def layers(self) -> tuple[Layer, ...]:
        """Return the depth layers, the nearest first."""

    @property
    def is_moving(self) -> bool:
        return any(self.velocity)

    def for_camera(self, camera: Camera) -> Target:
        """Return this target with a size that follows from the camera's frame, or itself.

        The same frame gives the same object again.
        """
        return self

    def reflected_radiance(self, reflectance: Spectrum | None = None) -> Spectrum:
        """Return the radiance of a matt surface (white by default) in this target's light."""
        lamp = (self.light or Spectrum.flat(1.0)).with_scale(self.radiance)
        return lamp if reflectance is None else lamp.times(reflectance)


@dataclass(frozen=True)
class Flat(Target):
    """Evenly lit field: a diffuser that fills more than the frame.

    Parameters
    ----------
    distance : float
        Distance from the panel in metres, positive. The blur, which has no effect on an even field,
        is rendered: it is smallest in focus.
    radiance : float
        Spectral radiance, W / (sr m² m), not negative.
    light, lamp, velocity, polarisation_angle, speckle, name : optional
        See `Target`.
    """

    distance: float
    radiance: float

    @cached_property
    def layers(self) -> tuple[Layer, ...]:
        return (Layer(self.distance, (Part(self.reflected_radiance(), UniformLight()),)),)


@dataclass(frozen=True)
class Dark(Target):
    """Target without any light: the lamp is off.

    Parameters
    ----------
    distance, radiance : float, default 2.0, 0.0
        Metres from the panel, positive, and W / (sr m² m); they have no effect on the picture.
    light, lamp, velocity, polarisation_angle, speckle, name : optional
        See `Target`.
    """

    distance: float = 2.0
    radiance: float = 0.0

    @property
    def layers(self) -> tuple[Layer, ...]:
        return (Layer(self.distance, ()),)


@dataclass(frozen=True)
class Scene:
    """Set of named targets, of which one stands before the camera at a time.

    Parameters
    ----------
    targets : mapping of str to Target, default a dark target
        The targets by name, at least one.

    Raises
    ------
    ValueError
        If there is no target.
    """

    targets: Mapping[str, Target] = field(default_factory=lambda: {"dark": Dark()})

    def __post_init__(self) -> None:
        if not self.targets:
            raise ValueError("targets is empty; a scene needs at least one")
