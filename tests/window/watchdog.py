"""Ends a test that takes too long, whether it hangs in Python or in one of Qt's loops."""

from __future__ import annotations

import gc
import signal
import threading
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

import dialogues
from PySide6.QtCore import QEventLoop, QTimer

LONGEST, LONGEST_TEARDOWN = 160.0, 30.0
"""Seconds of a test with its setup, and of its teardown: together less than pytest-timeout's."""

_SIGNAL = signal.SIGUSR2
_AGAIN = 2.0
"""Seconds after which an exception that ended nothing is raised once more."""

_CALLS = 4
"""Innermost calls that tell where a test hangs."""

_TICK = 50
"""Milliseconds between looks from within Qt's loops."""


class TakesTooLong(BaseException):
    """What a test hangs in. No test may catch it as if it were an error of the product."""


class Watchdog:
    """Lives as long as the session.

    An exception ends what hangs in Python, sleeps and locks included. It can't leave a loop of
    Qt's, which only swallows it: there, a timer ends the loop. What hangs in C without a loop
    is left to whoever ends the process.
    """

    def __init__(self) -> None:
        self._late: float | None = None
        self._held = ""
        self._timer: QTimer | None = None
        signal.signal(_SIGNAL, self._interrupt)

    def look_from_qt(self) -> None:
        """From now on, look at dialogues and at loops of Qt's, too: there is an application."""
        self._timer = QTimer(interval=_TICK)
        self._timer.timeout.connect(self._tick)
        self._timer.start()

    def set_no_limit(self) -> None:
        """Give what is going on all the time that it takes."""
        self._late = None

    def stop(self) -> None:
        self.set_no_limit()
        if self._timer is not None:
            self._timer.stop()

    @contextmanager
    def limit(self, seconds: float) -> Iterator[None]:
        """TakesTooLong, with the place, if what is done here lasts longer."""
        done = threading.Event()
        self._held, self._late = "", time.monotonic() + seconds
        watcher = threading.Thread(target=self._watch, args=(seconds, done), daemon=True)
        watcher.start()
        try:
            yield
        except BaseException as error:
            if self._held:
                # It may be what pytest-qt says of an exception that the loop has swallowed.
                error.add_note(self._held)
            raise
        finally:
            self._late = None
            done.set()
        if self._held:
            raise TakesTooLong(self._held)

    def _watch(self, seconds: float, done: threading.Event) -> None:
        while not done.wait(seconds):
            signal.pthread_kill(threading.main_thread().ident or 0, _SIGNAL)
            seconds = _AGAIN

    def _is_late(self, by: float = 0.0) -> bool:
        return self._late is not None and time.monotonic() > self._late + by

    def _interrupt(self, number: int, frame: FrameType | None) -> None:
        if self._is_late() and not _is_within(self._tick, frame):
            raise TakesTooLong("the test takes too long; it hangs in what is listed above")

    def _tick(self) -> None:
        dialogues.close_any()
        if self._is_late(by=_AGAIN / 2):
            calls = "".join(traceback.format_stack()[-_CALLS - 1 : -1])
            self._held = self._held or f"the test hangs in a loop of Qt's, here:\n{calls}"
            _end_loops()


def _is_within(method: object, frame: FrameType | None) -> bool:
    code = method.__code__  # type: ignore[attr-defined]
    while frame is not None and frame.f_code is not code:
        frame = frame.f_back
    return frame is not None


def _end_loops() -> None:
    for one in gc.get_objects():
        if issubclass(type(one), QEventLoop) and one.isRunning():
            one.exit(1)
