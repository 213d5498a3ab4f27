"""The scene file: what stands before the camera of a virtual bench."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import torch
from pydantic import Field

from labapp.files.reading import FileModel, read_picture
from simulator.scene import Dark, Photograph, Scene, Star, Target

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Distance = Annotated[float, Field(gt=0)]


class DarkTable(FileModel):
    kind: Literal["dark"]

    def build(self, folder: Path) -> Target:
        return Dark()


class StarTable(FileModel):
    """A lit pinhole. radiance: W / (sr m² nm)."""

    kind: Literal["star"]
    diameter_um: Positive
    distance_m: Distance
    radiance: Positive

    def build(self, folder: Path) -> Target:
        return Star(self.diameter_um * 1e-6, self.distance_m, self.radiance * 1e9)


class PhotographTable(FileModel):
    """A print of a picture file. radiance: of its white, W / (sr m² nm).

    credit: who made the picture; reports say it.
    """

    kind: Literal["photograph"]
    file: str
    distance_m: Distance
    radiance: Positive
    cover: Annotated[float, Field(gt=0, le=10)] = 1.05
    credit: str = ""

    def build(self, folder: Path) -> Target:
        picture = torch.from_numpy(read_picture(folder / self.file))
        return Photograph(picture, self.distance_m, self.radiance * 1e9, self.cover)


TargetTable = Annotated[DarkTable | StarTable | PhotographTable, Field(discriminator="kind")]


class SceneFile(FileModel):
    """Named targets, and how exactly they are simulated.

    tol: relative error of the mean picture that effects may be left out for.
    effects: effects that are on or off whatever their size.
    """

    version: Literal[1]
    title: str
    tol: Annotated[float, Field(gt=0, lt=1)] = 1e-2
    effects: dict[str, bool] = Field(default_factory=dict)
    targets: Annotated[dict[str, TargetTable], Field(min_length=1)]

    def build(self, folder: Path) -> Scene:
        """The scene; picture files are looked for in `folder`. UserError if one can't be read."""
        return Scene({name: table.build(folder) for name, table in self.targets.items()})
