"""An artificial star, and a pinhole."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from simulator.scene.disc import Disc
from simulator.scene.target import Layer, Part, Target


@dataclass(frozen=True)
class Star(Target):
    """An artificial star: a lit pinhole (thesis §3.4).

    diameter, distance: metres. radiance: W / (sr m² m). offset: (y, x) metres from the axis to
    it; like a print it stands upright in the picture, y down the rows.
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
    """A hole of a millimetre, lit from behind through the filter (thesis §5.6)."""

    diameter: float = 1e-3
    distance: float = 2.0
    radiance: float = 1e9
