"""What a run tells the person or program that attends it, asks of them, and lets them do."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from drivers.interfaces import Frame
from labapp.common.errors import WaitedTooLong
from labapp.runs.shots import Shot
from optics.progress import Progress

_INTERVAL = 0.05
"""Seconds between looks whether a wait is over. Chosen: a person notices no delay."""


class Meanwhile(Protocol):
    """What a caller does with the bench while a person is asked, or pauses the run.

    All is called in the thread of the run, which owns the bench. The run sets the exposure of
    every frame anew; the caller leaves all other settings as they are.
    """

    def begin(self) -> None:
        """Begin a wait."""

    def step(self, is_over: Callable[[], bool]) -> None:
        """Do something short, or wait for a moment; end early if `is_over` returns true."""

    def end(self) -> None:
        """End the wait; nothing of the caller's may go on with the bench."""


class Idle:
    """Does nothing with the bench during a wait."""

    def begin(self) -> None:
        pass

    def step(self, is_over: Callable[[], bool]) -> None:
        time.sleep(_INTERVAL)

    def end(self) -> None:
        pass


def wait_until(
    is_over: Callable[[], bool],
    progress: Progress,
    meanwhile: Meanwhile,
    limit: float = math.inf,
) -> None:
    """Wait until `is_over()` returns true, and let `meanwhile` use the bench.

    Raises Cancelled if the progress is cancelled, and WaitedTooLong after `limit` seconds.
    """
    late = time.monotonic() + limit
    meanwhile.begin()
    try:
        while not is_over():
            progress.raise_if_cancelled()
            if time.monotonic() >= late:
                raise WaitedTooLong(f"it has waited for {limit:g} s (--wait-limit)")
            meanwhile.step(lambda: progress.is_cancelled or is_over())
    finally:
        meanwhile.end()


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
