"""The person at the window, asked by a run."""

from __future__ import annotations

import threading
from collections.abc import Callable

from labapp.window.messages import Prompt
from optics.progress import Progress

_POLL_INTERVAL = 0.05
"""Seconds between looks at whether the run was cancelled."""


class PersonPrompter:
    """prompt: what is asked now, None if nothing is. on_change: is called when it changes."""

    def __init__(self, on_change: Callable[[], None]) -> None:
        self._on_change = on_change
        self._answer_event = threading.Event()
        self._count = 0
        self.prompt: Prompt | None = None

    def ask(self, text: str, progress: Progress) -> None:
        """Return when the person has answered; Cancelled if the run is cancelled instead."""
        self._answer_event.clear()
        self._count += 1
        self._show(Prompt(self._count, text))
        try:
            while not self._answer_event.wait(_POLL_INTERVAL):
                progress.raise_if_cancelled()
        finally:
            self._show(None)

    def answer(self, number: int) -> None:
        """An answer to an earlier prompt is none to this one: a key may be pressed twice."""
        prompt = self.prompt
        if prompt is not None and prompt.number == number:
            self._answer_event.set()

    def _show(self, prompt: Prompt | None) -> None:
        self.prompt = prompt
        self._on_change()
