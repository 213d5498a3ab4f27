"""The table [polarisation]: what stands in the light's way to the panel and back."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from labapp.files.quantities import Finite, Share
from labapp.files.reading import FileModel
from optics.polarisation import BeamSplitter, PolarisedPath, Polariser, SourcePolarisation


class PolarisedLightTable(FileModel):
    """Of the object: natural light by default. degree: of linear polarisation."""

    degree: Share = 0.0
    angle_deg: Finite = 0.0

    def build(self) -> SourcePolarisation:
        return SourcePolarisation(self.degree, math.radians(self.angle_deg))


class PolariserTable(FileModel):
    """angle_deg: from the panel's modulated axis. extinction: power along its axis over power
    across it, as in 1000 for 1000:1; inf is ideal. transmission: along its axis."""

    angle_deg: Finite = 0.0
    extinction: Annotated[float, Field(ge=1)] = math.inf
    transmission: Annotated[float, Field(gt=0, le=1)] = 1.0

    def build(self) -> Polariser:
        return Polariser(math.radians(self.angle_deg), self.extinction, self.transmission)


class SplitterTable(FileModel):
    """A cube that light passes to the panel and back. transmitted, reflected: shares of p and
    s light. angle_deg: from the panel's modulated axis to p. first: its way to the panel."""

    transmitted: tuple[Share, Share] = (0.5, 0.5)
    reflected: tuple[Share, Share] = (0.5, 0.5)
    angle_deg: Finite = 0.0
    first: Literal["transmitted", "reflected"] = "transmitted"

    @model_validator(mode="after")
    def _makes_no_light(self) -> SplitterTable:
        self.build()
        return self

    def build(self) -> BeamSplitter:
        return BeamSplitter(self.transmitted, self.reflected, math.radians(self.angle_deg))


class PolarisationTable(FileModel):
    """Elements in the order of the light; what isn't given isn't there.

    The panel's unmodulated share and a part of the camera's transmission follow from it.
    """

    light: PolarisedLightTable = PolarisedLightTable()
    polariser: PolariserTable | None = None
    splitter: SplitterTable | None = None
    analyser: PolariserTable | None = None

    @model_validator(mode="after")
    def _passes_light(self) -> PolarisationTable:
        self.build().effect()
        return self

    def build(self) -> PolarisedPath:
        return PolarisedPath(
            self.light.build(),
            self.polariser.build() if self.polariser else None,
            self.splitter.build() if self.splitter else None,
            self.analyser.build() if self.analyser else None,
            self.splitter.first if self.splitter else "transmitted",
        )
