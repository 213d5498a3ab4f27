"""The scene file: targets and lamps before the camera of a virtual bench."""

from __future__ import annotations

from dataclasses import replace
from os.path import normpath
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

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
"""Kinds of targets in a scene of version 1."""


class SceneFile(FileModel):
    """A scene file: targets and lamps by name, and the tolerance of their simulation.

    The simulator leaves out effects as long as the relative error of the picture stays below tol:
    by estimates that were audited on random scenes, or by bounds that prove it.
    effects forces single effects to be on, off, or at a named level, whatever their size. truth
    holds the properties of the virtual bench that differ from its bench file.
    """

    version: Literal[1, 2]
    title: str
    tol: Annotated[float, Field(gt=0, lt=1)] = 1e-2
    decide_by: Literal["estimate", "bound"] = "estimate"
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
        new = [name for name, one in self.targets.items() if not isinstance(one, _VERSION_1_KINDS)]
        if self.version == 1 and (new or self.lights):
            what = f"target {new[0]!r}" if new else "the table 'lights'"
            raise ValueError(f"{what} needs version = 2")
        return self

    def build(self) -> Scene:
        """Build the simulator's scene; UserError if a file that it names is wrong."""
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
        """Paths of the pictures and data that the scene names, each once, sorted."""
        return sorted(set(_collect_paths("", self)))

    def with_files_in(self, folder: Path) -> SceneFile:
        """Return the scene with absolute paths of its files, relative to `folder`."""
        return with_absolute_paths(self, folder)

    def with_photographs(self, changes: dict[str, str]) -> SceneFile:
        """Return the scene with changed keys in the tables of all photographs."""
        tables = {
            name: table.model_copy(update=changes) if isinstance(table, PhotographTable) else table
            for name, table in self.targets.items()
        }
        return self.model_copy(update={"targets": tables})


M = TypeVar("M", bound=FileModel)

PATH_KEYS = frozenset({"file", "disparity", "depth"})
"""Names of the keys in a scene's tables whose values are paths."""


def with_absolute_paths(table: M, folder: Path) -> M:
    """Return a table with absolute paths, those within its own tables included."""
    changes = {
        name: _make_absolute(name, getattr(table, name), folder)
        for name in type(table).model_fields
    }
    return table.model_copy(update=changes)


def _make_absolute(name: str, value: Any, folder: Path) -> Any:
    if isinstance(value, FileModel):
        return with_absolute_paths(value, folder)
    if isinstance(value, dict):
        return {key: _make_absolute("", one, folder) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return type(value)(_make_absolute("", one, folder) for one in value)
    return normpath(folder / value) if name in PATH_KEYS and isinstance(value, str) else value


def _collect_paths(name: str, value: Any) -> list[Path]:
    if isinstance(value, FileModel):
        fields = type(value).model_fields
        return [path for field in fields for path in _collect_paths(field, getattr(value, field))]
    if isinstance(value, dict | list | tuple):
        items = value.values() if isinstance(value, dict) else value
        return [path for one in items for path in _collect_paths("", one)]
    return [Path(value)] if name in PATH_KEYS and isinstance(value, str) else []
