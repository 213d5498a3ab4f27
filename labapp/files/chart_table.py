"""What can be printed or stand on a sheet: charts, patches, bricks. Sizes are at the object."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from labapp.files.quantities import Finite, Positive, Share
from labapp.files.reading import FileModel
from labapp.files.reflectance_table import Reflectance, reflectance_spectrum
from labapp.files.spectrum_file import bundled_spectra
from simulator.scene.bricks import brick
from simulator.scene.charts import checker, outline, siemens_star, slanted_edge, usaf_1951
from simulator.scene.drawable import Drawable, UniformLight
from simulator.scene.polygons import Polygons, rectangle
from simulator.scene.sheets import PaintedPicture


class _PlacedObject(FileModel):
    """offset_mm: [y, x] from the axis to its middle, as in the upright picture."""

    offset_mm: tuple[Finite, Finite] = (0.0, 0.0)

    @property
    def offset(self) -> tuple[float, float]:
        return self.offset_mm[0] * 1e-3, self.offset_mm[1] * 1e-3

    def content_and_outline(self) -> tuple[tuple[PaintedPicture, ...], Drawable]:
        """What is on it, and what it hides of what is behind it."""
        raise NotImplementedError


class _PrintedChart(_PlacedObject):
    """A chart in two tones: reflectances of its ink and its paper."""

    dark: Share = 0.05
    bright: Share = 0.9

    @model_validator(mode="after")
    def _can_be_printed(self) -> _PrintedChart:
        self.chart()
        return self

    def chart(self) -> Polygons:
        raise NotImplementedError

    def content_and_outline(self) -> tuple[tuple[PaintedPicture, ...], Drawable]:
        chart = self.chart()
        return ((None, chart),), outline(chart)


class SlantedEdge(_PrintedChart):
    """An edge that leans by an angle, for measuring the modulation transfer.

    size_mm: of the square sheet. horizontal: the edge is level, dark above.
    """

    kind: Literal["slanted-edge"]
    size_mm: Positive
    angle_deg: Annotated[float, Field(ge=-45, le=45)] = 5.0
    horizontal: bool = False

    def chart(self) -> Polygons:
        return slanted_edge(
            self.size_mm * 1e-3,
            math.radians(self.angle_deg),
            dark=self.dark,
            bright=self.bright,
            offset=self.offset,
            horizontal=self.horizontal,
        )


class SiemensStar(_PrintedChart):
    """A star of dark spokes as wide as the gaps between them."""

    kind: Literal["siemens"]
    diameter_mm: Positive
    spokes: Annotated[int, Field(ge=2, le=1000)] = 36

    def chart(self) -> Polygons:
        return siemens_star(
            self.diameter_mm * 1e-3,
            self.spokes,
            dark=self.dark,
            bright=self.bright,
            offset=self.offset,
        )


class UsafChart(_PrintedChart):
    """The USAF's chart of 1951; groups: the first and the last that are on it."""

    kind: Literal["usaf"]
    groups: tuple[int, int] = (-2, 1)

    def chart(self) -> Polygons:
        return usaf_1951(self.groups, dark=self.dark, bright=self.bright, offset=self.offset)


class ColorChecker(_PlacedObject):
    """The 24 patches of a ColorChecker Classic (Ohta 1997)."""

    kind: Literal["colorchecker"]
    width_mm: Positive

    def content_and_outline(self) -> tuple[tuple[PaintedPicture, ...], Drawable]:
        patches = list(bundled_spectra("colorchecker").values())
        painted = checker(patches, self.width_mm * 1e-3, self.offset)
        first = painted[0][1]
        assert isinstance(first, Polygons)
        return painted, outline(first)


class Brick(_PlacedObject):
    """The front of a toy brick. size_mm: [height, width] of its body."""

    kind: Literal["brick"]
    size_mm: tuple[Positive, Positive] = (9.6, 31.8)
    studs: Annotated[int, Field(ge=1, le=100)] = 4
    reflectance: Reflectance = "red"

    def content_and_outline(self) -> tuple[tuple[PaintedPicture, ...], Drawable]:
        height, width = self.size_mm
        picture, cover = brick((height * 1e-3, width * 1e-3), self.studs, self.offset)
        return ((reflectance_spectrum(self.reflectance), picture),), cover


class Patch(_PlacedObject):
    """Even colour: a rectangle, or without an end. size_mm: [height, width]."""

    kind: Literal["patch"]
    size_mm: tuple[Positive, Positive] | None = None
    angle_deg: Finite = 0.0
    reflectance: Reflectance = "grey"

    def content_and_outline(self) -> tuple[tuple[PaintedPicture, ...], Drawable]:
        paint = reflectance_spectrum(self.reflectance)
        if self.size_mm is None:
            return ((paint, UniformLight()),), UniformLight()
        height, width = self.size_mm
        angle = math.radians(self.angle_deg % 360)
        corners = rectangle(self.offset, (height * 1e-3, width * 1e-3), angle)
        picture = Polygons((corners,), (1.0,))
        return ((paint, picture),), picture


Chart = SlantedEdge | SiemensStar | UsafChart | ColorChecker | Brick | Patch
