"""Prompts of a run to a person."""

from __future__ import annotations

import threading
from collections.abc import Callable

from labapp.runs.acquisition.attendance import Idle, Meanwhile, wait_until
from labapp.window.messages import Prompt
from optics.progress import Progress


class PersonPrompter:
    """Ask a person to do something for a run.

    `on_change` is called when the prompt changes.
    prompt: the present one, None if there is none.
    """

    def __init__(self, on_change: Callable[[], None]) -> None:
        self._on_change = on_change
        self._answer_event = threading.Event()
        self._count = 0
        self._alternative = False
        self.prompt: Prompt | None = None

    def ask(
        self,
        text: str,
        progress: Progress,
        meanwhile: Meanwhile | None = None,
        *,
        done: str = "Done",
        alternative: str = "",
    ) -> bool:
        """Show a run's prompt, wait for the answer, and return whether it is the alternative.

        `meanwhile` uses the bench until the answer comes. Raises Cancelled if the run is cancelled.
        """
        self._answer_event.clear()
        self._alternative = False
        self._count += 1
        self._show(Prompt(self._count, text, done, alternative))
        try:
            wait_until(self._answer_event.is_set, progress, meanwhile or Idle())
        finally:
            self._show(None)
        return self._alternative

    def answer(self, number: int, *, alternative: bool = False) -> None:
        """Accept an answer to the present prompt only, since a person may press a key twice."""
        prompt = self.prompt
        if prompt is not None and prompt.number == number and not self._answer_event.is_set():
            self._alternative = alternative
            self._answer_event.set()

    def _show(self, prompt: Prompt | None) -> None:
        self.prompt = prompt
        self._on_change()
