"""What a study consists of: its definition, its settings and its results."""

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
    """Base class of a study's settings, which are fields with defaults that a person can change.

    A field's name ends in its unit, as in `radius_um`, and its description says what it is.
    `QUICK` has the values that --quick takes instead of the defaults.
    """

    QUICK: ClassVar[Mapping[str, Any]] = {}


S = TypeVar("S", bound=StudySettings)


@dataclass(frozen=True)
class ResultRow:
    """Compare one of our figures with the published one, or with what theory predicts.

    Attributes
    ----------
    what : str
        What the figure is.
    published : str
        The published figure with its source; "picture only" if the thesis prints no number.
    expected : str
        What theory predicts.
    ours : str
        The figure of this study.
    value : float or None
        The same as a number, for programs.
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
        """Make a row from the score of a restored picture.

        `published` has the published results in words, by the pictures' names.
        """
        ours = f"{score.psnr:.1f} dB, SSIM {score.ssim:.3f}"
        return cls(name, published.get(name, "-"), expected, ours, score.psnr)


@dataclass(frozen=True, eq=False)
class StudyFigure:
    """Hold a figure of the page, with its title and caption."""

    title: str
    figure: Figure
    caption: str


@dataclass(frozen=True, eq=False)
class StudyAnimation:
    """Hold an animation of the page; `data` is the content of a GIF file."""

    title: str
    data: bytes
    caption: str


@dataclass(frozen=True, eq=False)
class StudyResults:
    """Hold table, figures, animations and notes of an evaluation, and its data for programs.

    Attributes
    ----------
    rows : sequence of ResultRow
        At least one row of the table of results.
    figures : sequence of StudyFigure
        At least one figure; the first is also written as study.png.
    notes : sequence of str
        Sentences on the limits of the study, and on why its results may differ.
    data : mapping
        Further results for programs, of plain types and finite.
    animations : sequence of StudyAnimation
        Animations of the study's page.
    """

    rows: Sequence[ResultRow]
    figures: Sequence[StudyFigure]
    notes: Sequence[str] = ()
    data: Mapping[str, Any] = field(default_factory=dict)
    animations: Sequence[StudyAnimation] = ()


@dataclass(frozen=True)
class Study(Generic[S]):
    """Define a study, which repeats an experiment of the thesis.

    Attributes
    ----------
    title : str
        Title of the study.
    source : str
        Figure and section of the thesis.
    shows : str
        What the thesis shows there, in words.
    method : str
        What the study does, in words.
    settings : type
        The study's subclass of StudySettings.
    module : str
        The module with the functions `plan` and `evaluate`; imported when they are called.
    scene, bench : str
        Files in labapp/data for a virtual bench, used unless a person gives others.
    takes_colour : bool
        Whether the study evaluates pictures of a sensor with colour filters. Others refuse it.
    """

    title: str
    source: str
    shows: str
    method: str
    settings: type[S]
    module: str
    scene: str = "scene.toml"
    bench: str = "bench.toml"
    takes_colour: bool = False

    def plan(self, settings: S, camera: Camera) -> PlanFile:
        """Make the plan for the camera of a bench; the caller sets its seed."""
        plan: PlanFile = import_module(self.module).plan(settings, camera)
        return plan

    def evaluate(self, record: Record, settings: S, progress: Progress) -> StudyResults:
        """Get the results from the complete record of a run of the plan."""
        results: StudyResults = import_module(self.module).evaluate(record, settings, progress)
        return results
