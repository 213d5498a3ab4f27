"""Tables of a scene's targets. Radiances are in W / (sr m² nm), at the light's visible peak."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import torch
from pydantic import AfterValidator, Field

from labapp.common.errors import UserError
from labapp.files.chart_table import Chart, ColorChecker, SiemensStar, SlantedEdge, UsafChart
from labapp.files.light_table import Lamp
from labapp.files.picture.colour_picture import cached_picture
from labapp.files.picture.encoding import parse_encoding
from labapp.files.quantities import Finite, Positive
from labapp.files.reading import FileModel
from labapp.files.reflectance_table import reflectance_basis
from optics.speckle import RoughSurface
from simulator.scene import Dark, Flat, PhotographPrint, Pinhole, Sheet, Sheets, Star, Target

Distance = Annotated[float, Field(gt=0)]

Lamps = Mapping[str, Lamp]


def _known_encoding(word: str) -> str:
    """Return an encoding's own name; ValueError for unknown words."""
    try:
        return parse_encoding(word).name
    except UserError as error:
        raise ValueError(str(error).rstrip(".")) from error


EncodingName = Annotated[str, AfterValidator(_known_encoding)]
"""How a picture's numbers stand for light: "linear", "srgb", "gamma 2.2" and others."""


class MotionTable(FileModel):
    """A target's motion: velocity [y, x] across the axis, upright as in the picture."""

    velocity_mm_s: tuple[Finite, Finite]


class SpeckleTable(FileModel):
    """A target's rough surface, whose narrow-band light speckles: rms height of what scatters.

    optics.speckle.RoughSurface describes the keys.
    """

    roughness_um: Annotated[Positive, Field(le=1e6)]
    depolarises: bool = True
    patterns: Annotated[float, Field(ge=1, allow_inf_nan=False)] = 1.0

    def build(self) -> RoughSurface:
        return RoughSurface(self.roughness_um * 1e-6, self.depolarises, self.patterns)


class IlluminatedTargetTable(FileModel):
    """Base of all targets of a scene that give light.

    light names a lamp of the table [lights]; without it, the light is the same at all wavelengths.
    polarised_deg is the direction of linear polarisation, from x towards y; without it, the light
    is unpolarised. With speckle, the target is rough.
    """

    radiance: Positive
    light: str | None = None
    motion: MotionTable | None = None
    polarised_deg: Finite | None = None
    speckle: SpeckleTable | None = None

    def light_arguments(self, lamps: Lamps) -> dict[str, Any]:
        """Return the light and motion of the simulated target, in SI units and radians."""
        lamp = lamps[self.light] if self.light is not None else Lamp(None)
        velocity = self.motion.velocity_mm_s if self.motion else (0.0, 0.0)
        angle = self.polarised_deg
        return {
            "radiance": self.radiance * 1e9,
            "light": lamp.spectrum,
            "lamp": lamp.waveform,
            "velocity": (velocity[0] * 1e-3, velocity[1] * 1e-3),
            "polarisation_angle": None if angle is None else math.radians(angle % 180),
            "speckle": self.speckle.build() if self.speckle else None,
        }


class DarkTable(FileModel):
    kind: Literal["dark"]

    def build(self, lamps: Lamps) -> Target:
        return Dark()


class StarTable(IlluminatedTargetTable):
    """An artificial star; offset_um is [y, x] from the axis, as in the upright picture."""

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
    """A hole of about a millimetre that is lit from behind (thesis §5.6)."""

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
    """An evenly lit target that fills the whole field of view."""

    kind: Literal["flat"]
    distance_m: Distance

    def build(self, lamps: Lamps) -> Target:
        return Flat(distance=self.distance_m, **self.light_arguments(lamps))


class PictureTargetTable(IlluminatedTargetTable):
    """Base of the targets of a scene that are made from a picture file.

    cover is the size of the picture relative to the size at which it just covers the frame.
    height_mm, at the object, overrides it. offset_mm is [y, x] from the axis to the picture's
    middle. credit is the picture's author, whom reports name.
    """

    file: str
    cover: Annotated[float, Field(gt=0, le=10)] = 1.05
    height_mm: Positive | None = None
    offset_mm: tuple[Finite, Finite] = (0.0, 0.0)
    credit: str = ""

    def picture_arguments(self, lamps: Lamps) -> dict[str, Any]:
        """Return size, offset and light of the simulated target, in SI units."""
        y, x = self.offset_mm
        return {
            "cover": self.cover,
            "height": self.height_mm and self.height_mm * 1e-3,
            "offset": (y * 1e-3, x * 1e-3),
            **self.light_arguments(lamps),
        }


class PhotographTable(PictureTargetTable):
    """A print of a picture file, as a target of a scene.

    spectra is "mallett" for smooth reflectances of the picture's colours. With "primaries", red,
    green and blue are the reflectances at 610, 540 and 450 nm, with straight lines between.
    encoding says how the file's numbers stand for light, where the file doesn't say it rightly.
    """

    kind: Literal["photograph"]
    distance_m: Distance
    spectra: Literal["mallett", "primaries"] = "primaries"
    encoding: EncodingName | None = None

    def build(self, lamps: Lamps) -> Target:
        return PhotographPrint(
            image=torch.from_numpy(cached_picture(self.file, self.encoding)),
            distance=self.distance_m,
            basis=reflectance_basis(self.spectra),
            **self.picture_arguments(lamps),
        )


class _ChartTarget(IlluminatedTargetTable):
    """A target of a scene that is a single chart."""

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
    """An object of a layered scene at one distance, which hides the objects behind it."""

    distance_m: Distance
    picture: Annotated[Chart, Field(discriminator="kind")]


class LayersTable(IlluminatedTargetTable):
    """A target of a scene that is made of objects at several distances, the nearest first."""

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
