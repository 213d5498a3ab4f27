"""Point-like targets of the scene: an artificial star and a pinhole."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from simulator.scene.disc import Disc
from simulator.scene.target import Layer, Part, Target


@dataclass(frozen=True)
class Star(Target):
    """Scene target that is an artificial star: an illuminated pinhole (thesis §3.4).

    Parameters
    ----------
    diameter : float
        Diameter of the pinhole in metres, positive.
    distance : float
        Distance from the panel in metres, positive.
    radiance : float
        Spectral radiance of the pinhole, W / (sr m² m), not negative.
    offset : tuple of float, default (0.0, 0.0)
        Position (y, x) of the pinhole relative to the axis, metres on the object. The target
        appears upright in the picture, with y down the rows.
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
        return (
            Layer(
                self.distance, (Part(self.reflected_radiance(), Disc(self.diameter, self.offset)),)
            ),
        )


@dataclass(frozen=True)
class Pinhole(Star):
    """Scene target that is a pinhole, lit from behind through the filter (thesis §5.6).

    Parameters
    ----------
    diameter : float, default 1e-3
        Diameter of the pinhole in metres, positive.
    distance : float, default 2.0
        Distance from the panel in metres, positive.
    radiance : float, default 1e9
        Spectral radiance of the pinhole, W / (sr m² m), not negative.
    offset : tuple of float, default (0.0, 0.0)
        Position (y, x) of the pinhole relative to the axis, metres on the object.
    light, lamp, velocity, polarisation_angle, speckle, name : optional
        See `Target`.
    """

    diameter: float = 1e-3
    distance: float = 2.0
    radiance: float = 1e9
