"""The person at the window, asked by a run."""

from __future__ import annotations

import threading
from collections.abc import Callable

from labapp.window.messages import Prompt
from optics.progress import Progress

_LOOK = 0.05
"""Seconds between looks at whether the run was cancelled."""


class Person:
    """prompt: what is asked now, None if nothing is. changed: is called when it changes."""

    def __init__(self, changed: Callable[[], None]) -> None:
        self._changed = changed
        self._answered = threading.Event()
        self._count = 0
        self.prompt: Prompt | None = None

    def ask(self, text: str, progress: Progress) -> None:
        """Return when the person has answered; Cancelled if the run is cancelled instead."""
        self._answered.clear()
        self._count += 1
        self._show(Prompt(self._count, text))
        try:
            while not self._answered.wait(_LOOK):
                progress.check()
        finally:
            self._show(None)

    def answer(self, number: int) -> None:
        """An answer to an earlier prompt is none to this one: a key may be pressed twice."""
        prompt = self.prompt
        if prompt is not None and prompt.number == number:
            self._answered.set()

    def _show(self, prompt: Prompt | None) -> None:
        self.prompt = prompt
        self._changed()
