"""The commands that the window sends to its engine process, in SI units.

Both processes import this module, so it imports nothing heavy.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from labapp.window.exposure_bracket import RequestedBracket
from labapp.window.frame_reduction import FrameView

PatternTable = dict[str, Any]
"""A pattern in the form of a plan file: its kind, and the keys of that kind."""


class Command:
    """What the window may ask of its engine."""


@dataclass(frozen=True)
class SetLive(Command):
    """Start or stop the live view, for which the engine takes one picture after the other."""

    on: bool


@dataclass(frozen=True)
class PlaceTarget(Command):
    """Place a target before the camera; a person who places targets confirms it by this."""

    target: str


@dataclass(frozen=True)
class AskForTarget(Command):
    """Note that a person is asked to place a target by hand; "" if nobody is asked any more."""

    target: str


@dataclass(frozen=True)
class SetWavelength(Command):
    """Set the filter to a wavelength in metres."""

    wavelength: float


@dataclass(frozen=True)
class SetExposure(Command):
    """Set the camera's exposure time in seconds."""

    exposure: float


@dataclass(frozen=True)
class ComputePreview(Command):
    """Compute the preview of a pattern and of its PSF at a wavelength in metres."""

    pattern: PatternTable
    wavelength: float


@dataclass(frozen=True)
class ShowPattern(Command):
    """Compute a pattern and put it on the SLM."""

    pattern: PatternTable


@dataclass(frozen=True)
class ShowPatternAgain(Command):
    """Put a pattern on the SLM that was there before, by its number in BenchState."""

    number: int


@dataclass(frozen=True)
class AcquireBracket(Command):
    """Queue a run of exposure brackets of star and photograph; its record goes to `folder`.

    ticket: identifies the request, and begins the record's name; without one, the engine takes the
        time.
    """

    pattern: PatternTable
    wavelength: float
    star: RequestedBracket
    photograph: RequestedBracket
    folder: Path
    ticket: str = ""


@dataclass(frozen=True)
class RunPlan(Command):
    """Queue the run of a plan file; its record goes to `folder`, and is named by the ticket."""

    plan: Path
    folder: Path
    ticket: str = ""


@dataclass(frozen=True)
class ResumeRun(Command):
    """Queue a run of the frames that a record lacks."""

    path: Path
    ticket: str = ""


RunRequest = AcquireBracket | RunPlan | ResumeRun
"""A request for a run."""


@dataclass(frozen=True)
class KeptRequest:
    """A request from before a crash or a restart; `path` is its record, if one was named."""

    request: RunRequest
    path: Path | None = None


@dataclass(frozen=True)
class RestoreQueue(Command):
    """Queue the runs of kept requests again, held: none begins until a person says so.

    A run whose record was begun takes the frames that it lacks.
    reason: why they are held.
    """

    requests: tuple[KeptRequest, ...]
    reason: str


@dataclass(frozen=True)
class RemoveRuns(Command):
    """Remove runs that are still waiting from the queue, by their numbers."""

    numbers: tuple[int, ...]


@dataclass(frozen=True)
class ClearEndedRuns(Command):
    """Remove the runs that have ended from the queue; their files stay."""


@dataclass(frozen=True)
class ReleaseQueue(Command):
    """Begin the next run of the queue, although the last one failed or was cancelled."""


@dataclass(frozen=True)
class PauseRun(Command):
    """Pause the run under way after its current frame, or let it go on."""

    on: bool


@dataclass(frozen=True)
class AnswerPrompt(Command):
    """Confirm that a person has done what the run's prompt of this number asks for.

    alternative: whether the person chose the prompt's other answer.
    """

    number: int
    alternative: bool = False


@dataclass(frozen=True)
class ReconnectDevice(Command):
    """Open a failed device again; `device` is the bench's name of it."""

    device: str


@dataclass(frozen=True)
class OpenRecord(Command):
    """Show what a record holds, and one of its frames."""

    path: Path


@dataclass(frozen=True)
class ReconstructRun(Command):
    """Restore the blurred photograph of a record.

    method: one of optics.inverse.method_names, or DECODER.
    budget: processor time, s; None for the method's usual time.
    grey: whether one band of a sensor with colour filters is asked for.
    """

    path: Path
    method: str
    budget: float | None
    grey: bool = False


DECODER = "decoder"
"""The method that decodes a photograph behind a trained pattern, by the decoder of the pattern."""


@dataclass(frozen=True)
class SaveRestored(Command):
    """Write the photograph that was restored last to a file."""

    path: Path


@dataclass(frozen=True)
class SetTolerance(Command):
    """Compute predictions, and live pictures on the virtual bench, within a relative error.

    None returns to what is usual: 1e-3 for predictions, the scene's own tolerance for pictures.
    """

    tol: float | None


@dataclass(frozen=True)
class ForecastAccuracy(Command):
    """Predict what each tolerance costs, at a wavelength in metres and an exposure in seconds."""

    wavelength: float
    exposure: float


@dataclass(frozen=True)
class MeasureAccuracy(Command):
    """Measure what accuracy costs in all operations, and write the page to a new subfolder."""

    folder: Path


@dataclass(frozen=True)
class CancelJob(Command):
    """Cancel one kind of job of the engine; runs and other jobs go on."""

    job: str


@dataclass(frozen=True)
class Cancel(Command):
    """Cancel the run and the jobs that are under way; waiting runs stay in the queue."""


@dataclass(frozen=True)
class SetView(Command):
    """Tell what is shown of live frames, and the seconds between the screen's redraws."""

    view: FrameView
    refresh_interval: float


@dataclass(frozen=True)
class AcknowledgeFrame(Command):
    """Acknowledge that a live frame is on the screen, so that the engine sends the next one.

    The window no longer needs earlier frames.
    slot: that of the frame in shared memory.
    """

    slot: int
