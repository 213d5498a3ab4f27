"""Tables of a scene's targets. Radiances are W / (sr m² nm), at the light's visible peak."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import torch
from pydantic import Field

from labapp.common.errors import UserError
from labapp.files.chart_table import Chart, ColorChecker, SiemensStar, SlantedEdge, UsafChart
from labapp.files.light_table import Lamp
from labapp.files.picture_cache import cached_picture
from labapp.files.quantities import Finite, Positive
from labapp.files.reading import FileModel
from labapp.files.reflectance_table import reflectance_basis
from simulator.scene import Dark, Flat, PhotographPrint, Pinhole, Sheet, Sheets, Star, Target

Distance = Annotated[float, Field(gt=0)]

Lamps = Mapping[str, Lamp]


class MotionTable(FileModel):
    """velocity_mm_s: [y, x] across the axis at the object, upright as in the picture."""

    velocity_mm_s: tuple[Finite, Finite]


class IlluminatedTargetTable(FileModel):
    """What all targets but the dark have.

    light: a lamp of the table [lights]; none shines alike at all wavelengths. polarised_deg: the
    plane in which all of the target's light swings, from x towards y; none is unpolarised.
    """

    radiance: Positive
    light: str | None = None
    motion: MotionTable | None = None
    polarised_deg: Finite | None = None

    def light_arguments(self, lamps: Lamps) -> dict[str, Any]:
        """What a target is made with besides its picture."""
        lamp = lamps[self.light] if self.light is not None else Lamp(None)
        velocity = self.motion.velocity_mm_s if self.motion else (0.0, 0.0)
        angle = self.polarised_deg
        return {
            "radiance": self.radiance * 1e9,
            "light": lamp.spectrum,
            "lamp": lamp.waveform,
            "velocity": (velocity[0] * 1e-3, velocity[1] * 1e-3),
            "polarisation_angle": None if angle is None else math.radians(angle % 180),
        }


class DarkTable(FileModel):
    kind: Literal["dark"]

    def build(self, lamps: Lamps) -> Target:
        return Dark()


class StarTable(IlluminatedTargetTable):
    """A lit pinhole. offset_um: [y, x] from the axis to it, as in the upright picture."""

    kind: Literal["star"]
    diameter_um: Positive
    distance_m: Distance
    offset_um: tuple[Finite, Finite] = (0.0, 0.0)

    def build(self, lamps: Lamps) -> Target:
        y, x = self.offset_um
        return Star(
            diameter=self.diameter_um * 1e-6,
            distance=self.distance_m,
            offset=(y * 1e-6, x * 1e-6),
            **self.light_arguments(lamps),
        )


class PinholeTable(IlluminatedTargetTable):
    """A hole that is lit from behind, of a millimetre (thesis §5.6)."""

    kind: Literal["pinhole"]
    diameter_mm: Positive = 1.0
    distance_m: Distance
    offset_mm: tuple[Finite, Finite] = (0.0, 0.0)

    def build(self, lamps: Lamps) -> Target:
        y, x = self.offset_mm
        return Pinhole(
            diameter=self.diameter_mm * 1e-3,
            distance=self.distance_m,
            offset=(y * 1e-3, x * 1e-3),
            **self.light_arguments(lamps),
        )


class FlatTable(IlluminatedTargetTable):
    """An evenly lit field without an end."""

    kind: Literal["flat"]
    distance_m: Distance

    def build(self, lamps: Lamps) -> Target:
        return Flat(distance=self.distance_m, **self.light_arguments(lamps))


class PictureTargetTable(IlluminatedTargetTable):
    """A picture of pixels. cover: side of the picture over side of the frame, where it just
    covers it. height_mm: at the object, which counts instead of it where it is given.
    offset_mm: [y, x] from the axis to its middle. credit: who made it; reports say it.
    """

    file: str
    cover: Annotated[float, Field(gt=0, le=10)] = 1.05
    height_mm: Positive | None = None
    offset_mm: tuple[Finite, Finite] = (0.0, 0.0)
    credit: str = ""

    def picture_arguments(self, lamps: Lamps) -> dict[str, Any]:
        y, x = self.offset_mm
        return {
            "cover": self.cover,
            "height": self.height_mm and self.height_mm * 1e-3,
            "offset": (y * 1e-3, x * 1e-3),
            **self.light_arguments(lamps),
        }


class PhotographTable(PictureTargetTable):
    """A print of a picture file.

    spectra: "mallett" for smooth reflectances of its colours, "primaries" for lines between
    610, 540 and 450 nm, which its red, green and blue stand for.
    """

    kind: Literal["photograph"]
    distance_m: Distance
    spectra: Literal["mallett", "primaries"] = "primaries"

    def build(self, lamps: Lamps) -> Target:
        return PhotographPrint(
            image=torch.from_numpy(cached_picture(self.file)),
            distance=self.distance_m,
            basis=reflectance_basis(self.spectra),
            **self.picture_arguments(lamps),
        )


class _ChartTarget(IlluminatedTargetTable):
    """A chart that stands alone."""

    distance_m: Distance

    def build(self, lamps: Lamps) -> Target:
        assert isinstance(self, Chart)
        painted, _ = self.content_and_outline()
        return Sheets(sheets=(Sheet(self.distance_m, painted),), **self.light_arguments(lamps))


class SlantedEdgeTable(_ChartTarget, SlantedEdge):
    pass


class SiemensTable(_ChartTarget, SiemensStar):
    pass


class UsafTable(_ChartTarget, UsafChart):
    pass


class ColorCheckerTable(_ChartTarget, ColorChecker):
    pass


class LayerTable(FileModel):
    """What stands at one distance, and hides what is behind it."""

    distance_m: Distance
    picture: Annotated[Chart, Field(discriminator="kind")]


class LayersTable(IlluminatedTargetTable):
    """Things at distances, the nearest first."""

    kind: Literal["layers"]
    layers: Annotated[list[LayerTable], Field(min_length=1, max_length=64)]

    def build(self, lamps: Lamps) -> Target:
        sheets = tuple(
            Sheet(one.distance_m, *one.picture.content_and_outline()) for one in self.layers
        )
        try:
            return Sheets(sheets=sheets, **self.light_arguments(lamps))
        except ValueError as error:
            raise UserError(f"layers: {error}.") from error
