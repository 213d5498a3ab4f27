"""Read keys from the terminal during a run: pause, resume, and answers to prompts."""

from __future__ import annotations

import os
import select
import sys
import termios
import threading
import time
import tty
from collections.abc import Iterator
from contextlib import contextmanager

from labapp.common.errors import UserError, WaitedTooLong
from optics.progress import Progress

_POLL_INTERVAL = 0.05
"""Seconds between checks for a key, an answer or a cancellation."""


class Keyboard:
    """Reads standard input: p pauses, r resumes, and Enter or a key answers a prompt.

    A terminal is read only while this process is in its foreground. Other input is read only for
    answers, because it may be meant for another program. Use
    `with open_keyboard(progress) as keyboard`.
    """

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._question_pending, self._answer_given = threading.Event(), threading.Event()
        self._other_key, self._answer = b"", b""
        self._input_ended = threading.Event()
        self._done = threading.Event()
        threading.Thread(target=self._read, name="keyboard", daemon=True).start()

    def wait_for_enter(self, progress: Progress, other_key: str = "") -> bool:
        """Wait until Enter answers a prompt, or another key of a terminal does.

        Returns whether it was Enter. Raises UserError if standard input has ended, and
        WaitedTooLong after the seconds of the progress's wait limit.
        """
        late = time.monotonic() + progress.wait_limit
        self._other_key = other_key.encode()
        self._answer_given.clear()
        self._question_pending.set()
        try:
            while not self._answer_given.wait(_POLL_INTERVAL):
                progress.raise_if_cancelled()
                if time.monotonic() >= late:
                    raise WaitedTooLong(
                        f"nobody has answered within {progress.wait_limit:g} s (--wait-limit)"
                    )
                if self._input_ended.is_set() and not self._answer_given.is_set():
                    raise UserError(
                        "the run asks a person, and standard input has ended. Run it in a "
                        "terminal, or with --yes when all is in place."
                    )
        finally:
            self._question_pending.clear()
        return self._answer != self._other_key

    @property
    def is_terminal(self) -> bool:
        """Whether a person can answer by a single key, at a terminal."""
        return _is_at_terminal(_standard_input())

    def close(self) -> None:
        self._done.set()

    def _read(self) -> None:
        source = _standard_input()
        if source is None:
            self._input_ended.set()
            return
        terminal = os.isatty(source)
        while not self._done.is_set():
            if not (_is_in_foreground(source) if terminal else self._wants_answer):
                self._done.wait(_POLL_INTERVAL)
                continue
            ready, _, _ = select.select([source], [], [], _POLL_INTERVAL)
            if not ready:
                continue
            pressed = os.read(source, 1)
            if not pressed:
                self._input_ended.set()
                return
            self._press(pressed, terminal)

    @property
    def _wants_answer(self) -> bool:
        """Whether a prompt still waits for its answer, a single line of the input."""
        return self._question_pending.is_set() and not self._answer_given.is_set()

    def _press(self, key: bytes, terminal: bool) -> None:
        """Obey a key: Enter answers, p pauses and r resumes."""
        if key in b"\r\n" or (terminal and self._wants_answer and key.lower() == self._other_key):
            self._answer = key.lower()
            self._answer_given.set()
        elif terminal and key in b"pP":
            self._progress.pause()
        elif terminal and key in b"rR":
            self._progress.resume()


def _standard_input() -> int | None:
    """Return standard input's descriptor; None in a service or a test."""
    try:
        return sys.stdin.fileno()
    except (AttributeError, OSError, ValueError):
        return None


def _is_at_terminal(source: int | None) -> bool:
    """Return whether standard input is a terminal, with this process in its foreground."""
    return source is not None and os.isatty(source) and _is_in_foreground(source)


def _is_in_foreground(terminal: int) -> bool:
    """Return whether this process is in the terminal's foreground.

    The system stops a process that reads the terminal from the background.
    """
    try:
        return os.tcgetpgrp(terminal) == os.getpgrp()
    except OSError:
        return False


@contextmanager
def open_keyboard(progress: Progress) -> Iterator[Keyboard]:
    """Open the keyboard for prompts and pauses; in a terminal, keys need no Enter."""
    source = _standard_input()
    terminal = source if _is_at_terminal(source) else None
    before = termios.tcgetattr(terminal) if terminal is not None else None
    if terminal is not None:
        tty.setcbreak(terminal)
    keyboard = Keyboard(progress)
    try:
        yield keyboard
    finally:
        keyboard.close()
        if terminal is not None and before is not None and _is_in_foreground(terminal):
            termios.tcsetattr(terminal, termios.TCSADRAIN, before)
