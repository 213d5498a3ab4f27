"""What happens while a run waits for a person: nothing, or what its caller does meanwhile."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Protocol

from labapp.common.errors import WaitedTooLong
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
