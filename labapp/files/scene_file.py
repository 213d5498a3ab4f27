"""The scene file: what stands before the camera of a virtual bench."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from labapp.common.errors import UserError
from labapp.files.light_table import LightTable
from labapp.files.measured_targets import CubeTable, DisplayTable, ReliefTable
from labapp.files.reading import FileModel
from labapp.files.scene_targets import (
    ColorCheckerTable,
    DarkTable,
    FlatTable,
    LayersTable,
    PinholeTable,
    SiemensTable,
    SlantedEdgeTable,
    UsafTable,
)
from labapp.files.scene_targets import PhotographTable as PhotographTable
from labapp.files.scene_targets import StarTable as StarTable
from labapp.files.table_paths import referenced_files, with_absolute_paths
from labapp.files.true_bench_table import TrueBenchTable
from simulator.scene import Scene

TargetTable = Annotated[
    DarkTable
    | StarTable
    | PinholeTable
    | FlatTable
    | PhotographTable
    | CubeTable
    | ColorCheckerTable
    | SlantedEdgeTable
    | SiemensTable
    | UsafTable
    | LayersTable
    | ReliefTable
    | DisplayTable,
    Field(discriminator="kind"),
]

_VERSION_1_KINDS = (DarkTable, StarTable, FlatTable, PhotographTable)
"""Kinds that the first version of the format has."""


class SceneFile(FileModel):
    """Named targets and lamps, and how exactly they are simulated.

    tol: relative error of the picture that effects may be left out for. effects: those that are
    on, off, or at a level of theirs, whatever their size. truth: what the bench really is, where
    that differs from the bench file.
    """

    version: Literal[1, 2]
    title: str
    tol: Annotated[float, Field(gt=0, lt=1)] = 1e-2
    effects: dict[str, bool | str] = Field(default_factory=dict)
    lights: dict[str, LightTable] = Field(default_factory=dict)
    targets: Annotated[dict[str, TargetTable], Field(min_length=1)]
    truth: TrueBenchTable | None = None

    @model_validator(mode="after")
    def _fits_together(self) -> SceneFile:
        for name, table in self.targets.items():
            light = getattr(table, "light", None)
            if light is not None and light not in self.lights:
                known = ", ".join(self.lights) or "none is given"
                raise ValueError(
                    f"target {name!r} stands in the light of {light!r}, which isn't in the table "
                    f"'lights' ({known})"
                )
        if self.version == 1:
            self._require_version_1_content()
        return self

    def _require_version_1_content(self) -> None:
        new = [name for name, one in self.targets.items() if not isinstance(one, _VERSION_1_KINDS)]
        if new or self.lights:
            what = f"target {new[0]!r}" if new else "the table 'lights'"
            raise ValueError(f"{what} needs version = 2")

    def build(self) -> Scene:
        """The scene; UserError if a file can't be read, or doesn't hold what it should."""
        lamps = {name: light.build() for name, light in self.lights.items()}
        built = {}
        for name, table in self.targets.items():
            try:
                built[name] = replace(table.build(lamps), name=name)
            except ValueError as error:
                raise UserError(f"target {name!r}: {error}.") from error
        return Scene(built)

    @property
    def input_files(self) -> list[Path]:
        """The files that the scene needs: pictures, and tables of numbers."""
        return referenced_files(self)

    def with_files_in(self, folder: Path) -> SceneFile:
        """The scene with absolute paths of its files, looked for in `folder`."""
        return with_absolute_paths(self, folder)

    def with_photographs(self, changes: dict[str, str]) -> SceneFile:
        """The scene with keys of all its photographs changed."""
        tables = {
            name: table.model_copy(update=changes) if isinstance(table, PhotographTable) else table
            for name, table in self.targets.items()
        }
        return self.model_copy(update={"targets": tables})
