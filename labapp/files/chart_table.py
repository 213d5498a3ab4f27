"""Tables of a scene's charts, patches and toy bricks. Sizes are those of the object."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from labapp.files.quantities import Finite, Positive, Share
from labapp.files.reading import FileModel
from labapp.files.reflectance_table import Reflectance, reflectance_spectrum
from labapp.files.spectrum_file import bundled_spectra
from simulator.scene.charts import checker, outline, siemens_star, slanted_edge, usaf_1951
from simulator.scene.drawable import Drawable, UniformLight
from simulator.scene.polygons import Polygons, brick, rectangle
from simulator.scene.sheets import PaintedPicture


class _PlacedObject(FileModel):
    """A scene's object beside the axis.

    offset_mm is the vector [y, x] from the axis to its middle, as in the upright picture.
    """

    offset_mm: tuple[Finite, Finite] = (0.0, 0.0)

    @property
    def offset(self) -> tuple[float, float]:
        return self.offset_mm[0] * 1e-3, self.offset_mm[1] * 1e-3

    def content_and_outline(self) -> tuple[tuple[PaintedPicture, ...], Drawable]:
        """Return the painted pictures on the object, and the outline that hides what is behind."""
        raise NotImplementedError


class _PrintedChart(_PlacedObject):
    """A test chart in two tones; dark and bright are the reflectances of ink and paper."""

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
    """A slanted-edge chart, for measuring the MTF.

    size_mm is the side of the square sheet. With horizontal, the edge is level and dark above.
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
    """A Siemens star, whose dark spokes are as wide as the gaps between them."""

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
    """The USAF 1951 resolution chart; groups are the first and the last group on it."""

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
    """The front of a toy brick; size_mm is [height, width] of its body without the studs."""

    kind: Literal["brick"]
    size_mm: tuple[Positive, Positive] = (9.6, 31.8)
    studs: Annotated[int, Field(ge=1, le=100)] = 4
    reflectance: Reflectance = "red"

    def content_and_outline(self) -> tuple[tuple[PaintedPicture, ...], Drawable]:
        height, width = self.size_mm
        picture, cover = brick((height * 1e-3, width * 1e-3), self.studs, self.offset)
        return ((reflectance_spectrum(self.reflectance), picture),), cover


class Patch(_PlacedObject):
    """A rectangle of one reflectance, size_mm = [height, width]; without size_mm it is endless."""

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
