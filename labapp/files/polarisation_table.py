"""A camera's table [polarisation]: polarising elements before and after the panel."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from labapp.files.quantities import Finite, Share
from labapp.files.reading import FileModel
from optics.polarisation import BeamSplitter, PolarisedPath, Polariser, SourcePolarisation


class PolarisedLightTable(FileModel):
    """Polarisation of the object's light; degree is that of linear polarisation, 0 by default."""

    degree: Share = 0.0
    angle_deg: Finite = 0.0

    def build(self) -> SourcePolarisation:
        return SourcePolarisation(self.degree, math.radians(self.angle_deg))


class PolariserTable(FileModel):
    """A polariser in the path to or from the panel.

    angle_deg is measured from the panel's modulated axis. extinction is the power along the
    polariser's axis over the power across it, for example 1000 for 1000:1; inf is ideal.
    transmission is that along the axis.
    """

    angle_deg: Finite = 0.0
    extinction: Annotated[float, Field(ge=1)] = math.inf
    transmission: Annotated[float, Field(gt=0, le=1)] = 1.0

    def build(self) -> Polariser:
        return Polariser(math.radians(self.angle_deg), self.extinction, self.transmission)


class SplitterTable(FileModel):
    """A beam splitter cube, which light passes on its way to the panel and back.

    transmitted and reflected are shares of p and s light. angle_deg is the angle from the panel's
    modulated axis to the p direction. first says whether the light is transmitted or reflected on
    its way to the panel.
    """

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
    """The polarising elements of a camera in the order of the light; elements left out are absent.

    The panel's unmodulated share and a part of the camera's transmission follow from them.
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
