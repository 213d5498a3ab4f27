"""Flat sheets at several distances, which hide what is behind them, as a target."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from optics.light.spectrum import Spectrum
from simulator.scene.drawable import Drawable
from simulator.scene.target import Layer, Part, Target, require_distance

PaintedPicture = tuple[Spectrum | None, Drawable]
"""A reflectance, None for white at all wavelengths, and a picture of its share at each point."""


@dataclass(frozen=True, eq=False)
class Sheet:
    """Flat surface across the axis, with what it shows and what it hides.

    Parameters
    ----------
    distance : float
        Distance from the panel in metres, positive.
    pictures : tuple of tuple
        Pairs of a reflectance (None for white) and a picture, which add up.
    cover : Drawable, optional
        Picture of the share of the light from behind that the sheet hides; None hides nothing.

    Raises
    ------
    ValueError
        If the distance isn't positive.
    """

    distance: float
    pictures: tuple[PaintedPicture, ...]
    cover: Drawable | None = None

    def __post_init__(self) -> None:
        require_distance(self.distance)


@dataclass(frozen=True, eq=False)
class Sheets(Target):
    """Matt, evenly lit sheets at several distances.

    Parameters
    ----------
    sheets : tuple of Sheet
        The sheets, the nearest first, no two at one distance.
    radiance : float
        Spectral radiance of white, W / (sr m² m), not negative.
    light, lamp, velocity, polarisation_angle, speckle, name : optional
        See `Target`.

    Raises
    ------
    ValueError
        If there is no sheet, or the distances don't ascend.
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
        found = []
        for sheet in self.sheets:
            parts = [Part(self.reflected_radiance(paint), one) for paint, one in sheet.pictures]
            found.append(Layer(sheet.distance, tuple(parts), sheet.cover))
        return tuple(found)
