"""What a run tells the person or program that attends it, asks of them, and lets them do."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from drivers.interfaces import Frame
from labapp.runs.acquisition.waiting import Meanwhile
from labapp.runs.shots import Shot
from optics.progress import Progress

AskOperator = Callable[[str, Progress], None]
"""Prompts a person and returns when they have answered; raises Cancelled if the run is ended."""

JudgeFrame = Callable[[str, Shot, Frame, Progress], bool]
"""Shows a person a frame that is doubted, with the reason; returns whether the frame is kept, and
else it is taken again. Raises Cancelled if the run is ended."""

OnFrame = Callable[[Shot, Frame], None]

OnPlanned = Callable[[Sequence[Shot]], None]
"""Called with the shots of a run once all of them are known."""


@dataclass(frozen=True)
class Attendance:
    """What a run tells the person or program that attends it, asks of them, and lets them do.

    Parameters
    ----------
    progress : Progress
        Reports the run's progress. Pausing it pauses the run after a frame; cancelling it ends
        the run.
    ask : AskOperator, optional
        Prompts a person. It is needed if the plan has prompts.
    judge : JudgeFrame, optional
        Asks a person about a frame that shows something else than it was taken for. Without it,
        the frame is kept, and the record's log has the doubt.
    on_planned : callable, optional
        Called with all shots of a new run, before the first, once the exposures of brackets and
        the times of frames are known.
    on_frame : callable, optional
        Called with each shot and its frame, once the frame is in the record.
    meanwhile : Meanwhile, optional
        May use the bench while the user pauses the run, as for live pictures.
    """

    progress: Progress = field(default_factory=Progress)
    ask: AskOperator | None = None
    judge: JudgeFrame | None = None
    on_planned: OnPlanned | None = None
    on_frame: OnFrame | None = None
    meanwhile: Meanwhile | None = None
