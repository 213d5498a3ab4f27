"""What a study is, and what it finds."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Generic, TypeVar

from matplotlib.figure import Figure

from labapp.files.plan_file import PlanFile
from labapp.files.reading import FileModel
from labapp.record.reader import Record
from optics.camera import Camera
from optics.progress import Progress


class Settings(FileModel):
    """What a person can set, one field each, with a default.

    A field's name ends in its unit, as in `radius_um`, and its description says what it is.
    QUICK: the values that --quick takes instead of the defaults.
    """

    QUICK: ClassVar[Mapping[str, Any]] = {}


S = TypeVar("S", bound=Settings)


@dataclass(frozen=True)
class Row:
    """A figure of the study: what was published, or must be by theory, and ours.

    published: in words, with its source; "picture only" where the thesis prints no number, and
    `expected` then says what physics asks for. value: ours as a number, for programs.
    """

    what: str
    published: str
    expected: str
    ours: str
    value: float | None = None


@dataclass(frozen=True, eq=False)
class Plate:
    """A picture of the study's page."""

    title: str
    figure: Figure
    caption: str


@dataclass(frozen=True, eq=False)
class Movie:
    """A moving picture of the study's page. data: a GIF file."""

    title: str
    data: bytes
    caption: str


@dataclass(frozen=True, eq=False)
class Results:
    """What a study found.

    rows: one at least. plates: one at least; the first is also written as study.png. notes:
    sentences on what the study can't tell, and why ours may differ. data: further figures for
    programs, plain and finite.
    """

    rows: Sequence[Row]
    plates: Sequence[Plate]
    notes: Sequence[str] = ()
    data: Mapping[str, Any] = field(default_factory=dict)
    movies: Sequence[Movie] = ()


@dataclass(frozen=True)
class Study(Generic[S]):
    """An experiment of the thesis.

    source: figure and section of the thesis. shows: what is published there, in words.
    method: what is done here, in words. plan: from settings and the camera of the bench; its
    seed is set by who runs it. evaluate: from a complete record. scene, bench: files in
    labapp/data, for a virtual bench, unless a person gives others.
    """

    title: str
    source: str
    shows: str
    method: str
    settings: type[S]
    plan: Callable[[S, Camera], PlanFile]
    evaluate: Callable[[Record, S, Progress], Results]
    scene: str = "scene.toml"
    bench: str = "bench.toml"
