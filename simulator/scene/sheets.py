"""Flat things at distances, which hide what is behind them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from optics.light.spectrum import Spectrum
from simulator.scene.drawable import Drawable
from simulator.scene.target import Layer, Part, Target, require_distance

PaintedPicture = tuple[Spectrum | None, Drawable]
"""A reflectance, None for white at all wavelengths, and where there is how much of it."""


@dataclass(frozen=True, eq=False)
class Sheet:
    """What lies in a plane across the axis.

    distance: metres from the panel. pictures: adds up. cover: the share of what is behind that it
    hides; None hides nothing.
    """

    distance: float
    pictures: tuple[PaintedPicture, ...]
    cover: Drawable | None = None

    def __post_init__(self) -> None:
        require_distance(self.distance)


@dataclass(frozen=True, eq=False)
class Sheets(Target):
    """Sheets, the nearest first, matt and evenly lit.

    radiance: of white, W / (sr m² m).
    """

    sheets: tuple[Sheet, ...]
    radiance: float

    def __post_init__(self) -> None:
        if not self.sheets:
            raise ValueError("sheets is empty; give at least one")
        distances = [one.distance for one in self.sheets]
        if sorted(set(distances)) != distances:
            raise ValueError(
                f"sheets stand at {', '.join(f'{d:g}' for d in distances)} m; give the nearest "
                "first, and no two at one distance"
            )
        object.__setattr__(self, "distance", distances[0])
        super().__post_init__()

    @cached_property
    def layers(self) -> tuple[Layer, ...]:
        return tuple(
            Layer(
                sheet.distance,
                tuple(
                    Part(self.reflected_radiance(paint), picture)
                    for paint, picture in sheet.pictures
                ),
                sheet.cover,
            )
            for sheet in self.sheets
        )
