"""The scene file: what stands before the camera of a virtual bench."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import Field

from labapp.files.reading import FileModel, read_picture
from labapp.files.truth_table import TruthTable
from simulator.scene import Dark, Flat, Photograph, Scene, Star, Target

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Distance = Annotated[float, Field(gt=0)]


class DarkTable(FileModel):
    kind: Literal["dark"]

    def build(self) -> Target:
        return Dark()


class StarTable(FileModel):
    """A lit pinhole. radiance: W / (sr m² nm).

    offset_um: [y, x] from the axis to the pinhole, as in the upright picture.
    """

    kind: Literal["star"]
    diameter_um: Positive
    distance_m: Distance
    radiance: Positive
    offset_um: tuple[Finite, Finite] = (0.0, 0.0)

    def build(self) -> Target:
        y, x = self.offset_um
        return Star(
            self.diameter_um * 1e-6, self.distance_m, self.radiance * 1e9, (y * 1e-6, x * 1e-6)
        )


class FlatTable(FileModel):
    """An evenly lit field. radiance: W / (sr m² nm)."""

    kind: Literal["flat"]
    distance_m: Distance
    radiance: Positive

    def build(self) -> Target:
        return Flat(self.distance_m, self.radiance * 1e9)


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

    def build(self) -> Target:
        picture = torch.from_numpy(_picture(self.file, _changed(self.file)))
        return Photograph(picture, self.distance_m, self.radiance * 1e9, self.cover)


TargetTable = Annotated[
    DarkTable | StarTable | FlatTable | PhotographTable, Field(discriminator="kind")
]


class SceneFile(FileModel):
    """Named targets, and how exactly they are simulated.

    tol: relative error of the mean picture that effects may be left out for.
    effects: effects that are on or off whatever their size. truth: what the bench really is,
    where that differs from the bench file.
    """

    version: Literal[1]
    title: str
    tol: Annotated[float, Field(gt=0, lt=1)] = 1e-2
    effects: dict[str, bool] = Field(default_factory=dict)
    targets: Annotated[dict[str, TargetTable], Field(min_length=1)]
    truth: TruthTable | None = None

    def build(self) -> Scene:
        """The scene; UserError if a picture can't be read."""
        return Scene({name: table.build() for name, table in self.targets.items()})

    @property
    def pictures(self) -> list[Path]:
        """The picture files that the scene needs."""
        tables = self.targets.values()
        return sorted({Path(t.file) for t in tables if isinstance(t, PhotographTable)})

    def found_in(self, folder: Path) -> SceneFile:
        """The scene with absolute paths of its pictures, looked for in `folder`."""
        tables = {
            name: table.model_copy(update={"file": str(folder / table.file)})
            if isinstance(table, PhotographTable)
            else table
            for name, table in self.targets.items()
        }
        return self.model_copy(update={"targets": tables})

    def with_photographs(self, changes: dict[str, str]) -> SceneFile:
        """The scene with keys of all its photographs changed."""
        tables = {
            name: table.model_copy(update=changes) if isinstance(table, PhotographTable) else table
            for name, table in self.targets.items()
        }
        return self.model_copy(update={"targets": tables})


@lru_cache(maxsize=2)
def _picture(file: str, changed: int) -> NDArray[np.float32]:
    """Read once, though many targets may be prints of it; again when it has changed."""
    return read_picture(Path(file))


def _changed(file: str) -> int:
    try:
        return Path(file).stat().st_mtime_ns
    except OSError:
        return 0
