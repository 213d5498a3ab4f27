"""Keys that a person presses while a run is under way: pause, go on, and answers."""

from __future__ import annotations

import os
import select
import sys
import termios
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager

from labapp.common.errors import UserError
from optics.progress import Progress

_LOOK = 0.05
"""Seconds between looks at whether somebody has answered, or has cancelled."""


class Keyboard:
    """Reads standard input beside a run: p pauses, r goes on, Enter answers a question.

    What isn't a terminal is only read for answers, for it may be somebody's else; a terminal
    only while the run is in its foreground. progress: of the run. Use it as
    `with listening(progress) as keyboard`.
    """

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._asked, self._entered = threading.Event(), threading.Event()
        self._gone = threading.Event()
        self._done = threading.Event()
        threading.Thread(target=self._read, name="keyboard", daemon=True).start()

    def wait_for_enter(self, progress: Progress) -> None:
        """Return when Enter is pressed from now on. UserError if nobody ever can."""
        self._entered.clear()
        self._asked.set()
        try:
            while not self._entered.wait(_LOOK):
                progress.check()
                if self._gone.is_set() and not self._entered.is_set():
                    raise UserError(
                        "the run asks a person, and standard input has ended. Run it in a "
                        "terminal, or with --yes when all is in place."
                    )
        finally:
            self._asked.clear()

    def close(self) -> None:
        self._done.set()

    def _read(self) -> None:
        source = _standard_input()
        if source is None:
            self._gone.set()
            return
        terminal = os.isatty(source)
        while not self._done.is_set():
            if not (_is_ours(source) if terminal else self._wants_answer):
                self._done.wait(_LOOK)
                continue
            ready, _, _ = select.select([source], [], [], _LOOK)
            if not ready:
                continue
            pressed = os.read(source, 1)
            if not pressed:
                self._gone.set()
                return
            self._press(pressed, terminal)

    @property
    def _wants_answer(self) -> bool:
        """Each question takes one line: the next one belongs to the next question."""
        return self._asked.is_set() and not self._entered.is_set()

    def _press(self, key: bytes, terminal: bool) -> None:
        if key in b"\r\n":
            self._entered.set()
        elif terminal and key in b"pP":
            self._progress.pause()
        elif terminal and key in b"rR":
            self._progress.resume()


def _standard_input() -> int | None:
    """Its number, None where there is none, as in a service or under a test."""
    try:
        return sys.stdin.fileno()
    except (AttributeError, OSError, ValueError):
        return None


def _is_ours(terminal: int) -> bool:
    """Whether this process is in the terminal's foreground: who reads behind it is stopped."""
    try:
        return os.tcgetpgrp(terminal) == os.getpgrp()
    except OSError:
        return False


@contextmanager
def listening(progress: Progress) -> Iterator[Keyboard]:
    """A keyboard whose keys are heard one by one, without Enter, where it is a terminal."""
    source = _standard_input()
    terminal = source if source is not None and os.isatty(source) and _is_ours(source) else None
    before = termios.tcgetattr(terminal) if terminal is not None else None
    if terminal is not None:
        tty.setcbreak(terminal)
    keyboard = Keyboard(progress)
    try:
        yield keyboard
    finally:
        keyboard.close()
        if terminal is not None and before is not None and _is_ours(terminal):
            termios.tcsetattr(terminal, termios.TCSADRAIN, before)
