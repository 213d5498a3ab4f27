"""What a study is, and what it finds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

from labapp.files.reading import FileModel

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from labapp.files.plan_file import PlanFile
    from labapp.pictures.analysis.score import Score
    from labapp.runs.record.reader import Record
    from optics.camera import Camera
    from optics.progress import Progress


class StudySettings(FileModel):
    """What a person can set, one field each, with a default.

    A field's name ends in its unit, as in `radius_um`, and its description says what it is.
    QUICK: the values that --quick takes instead of the defaults.
    """

    QUICK: ClassVar[Mapping[str, Any]] = {}


S = TypeVar("S", bound=StudySettings)


@dataclass(frozen=True)
class ResultRow:
    """A figure of the study: what was published, or must be by theory, and ours.

    published: in words, with its source; "picture only" where the thesis prints no number, and
    `expected` then says what physics asks for. value: ours as a number, for programs.
    """

    what: str
    published: str
    expected: str
    ours: str
    value: float | None = None

    @classmethod
    def of_score(
        cls, name: str, score: Score, published: Mapping[str, str], expected: str = "-"
    ) -> ResultRow:
        """How near a picture comes to the sharp one. published: words by the pictures' names."""
        ours = f"{score.psnr:.1f} dB, SSIM {score.ssim:.3f}"
        return cls(name, published.get(name, "-"), expected, ours, score.psnr)


@dataclass(frozen=True, eq=False)
class StudyFigure:
    """A picture of the study's page."""

    title: str
    figure: Figure
    caption: str


@dataclass(frozen=True, eq=False)
class StudyAnimation:
    """A moving picture of the study's page. data: a GIF file."""

    title: str
    data: bytes
    caption: str


@dataclass(frozen=True, eq=False)
class StudyResults:
    """What a study found.

    rows: one at least. figures: one at least; the first is also written as study.png. notes:
    sentences on what the study can't tell, and why ours may differ. data: further figures for
    programs, plain and finite.
    """

    rows: Sequence[ResultRow]
    figures: Sequence[StudyFigure]
    notes: Sequence[str] = ()
    data: Mapping[str, Any] = field(default_factory=dict)
    animations: Sequence[StudyAnimation] = ()


@dataclass(frozen=True)
class Study(Generic[S]):
    """An experiment of the thesis.

    source: figure and section of the thesis. shows: what is published there, in words.
    method: what is done here, in words. module: has its functions `plan` and `evaluate`, and is
    imported when they are called. scene, bench: files in labapp/data, for a virtual bench, unless
    a person gives others.
    """

    title: str
    source: str
    shows: str
    method: str
    settings: type[S]
    module: str
    scene: str = "scene.toml"
    bench: str = "bench.toml"

    def plan(self, settings: S, camera: Camera) -> PlanFile:
        """What is to be acquired, for the camera of a bench; its seed is set by who runs it."""
        plan: PlanFile = import_module(self.module).plan(settings, camera)
        return plan

    def evaluate(self, record: Record, settings: S, progress: Progress) -> StudyResults:
        """What a complete record shows."""
        results: StudyResults = import_module(self.module).evaluate(record, settings, progress)
        return results
