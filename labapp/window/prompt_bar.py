"""Bar for a run that waits for a person: its prompt, or why it is paused."""

from __future__ import annotations

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QAction
from PySide6.QtWidgets import QHBoxLayout, QPushButton, QWidget

from labapp.runs.state import State
from labapp.window.messages import Prompt, QueueState
from labapp.window.widgets import fill_layout, make_label, make_tool_button


class PromptBar(QWidget):
    """Show a run's prompt, or why the run is paused, above the picture.

    `prompt_done` is emitted with the prompt's number when the person has done what it asks for,
    and with whether the person chose its other answer.
    """

    prompt_done = Signal(int, bool)

    def __init__(self, pause: QAction, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("call")
        self.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)
        self._label = make_label(self, wrap=True)
        self.done_button = QPushButton("Done  Enter", self)
        self.other_button = QPushButton(self)
        self.resume_button = make_tool_button(self, pause)
        self._prompt: Prompt | None = None
        parts = (self._label, 1), self.done_button, self.other_button, self.resume_button
        fill_layout(QHBoxLayout(self), *parts, margins=(10, 6, 6, 6))
        self.done_button.clicked.connect(lambda: self._answer(alternative=False))
        self.other_button.clicked.connect(lambda: self._answer(alternative=True))
        self.hide()

    @property
    def text(self) -> str:
        return self._label.text() if self.isVisible() else ""

    @property
    def is_asking(self) -> bool:
        """Return whether a prompt is shown, which Enter confirms."""
        return self.isVisible() and self.done_button.isVisible()

    def show_queue(self, queue: QueueState) -> None:
        run = queue.current_run
        if queue.prompt is not None:
            self._ask(queue.prompt)
        elif run is not None and run.state is State.PAUSED:
            self._show(
                f"PAUSED: {run.message}", self.resume_button if run.pause_requested else None
            )
        else:
            self.hide()

    def _ask(self, prompt: Prompt) -> None:
        if prompt != self._prompt:
            self._prompt = prompt
            self._allow(True)
            self.done_button.setText(f"{prompt.done}  Enter")
            self.other_button.setText(prompt.alternative)
        others = (self.other_button,) if prompt.alternative else ()
        self._show(prompt.text, self.done_button, *others)

    def _show(self, text: str, *buttons: QWidget | None) -> None:
        self._label.setText(text)
        for one in (self.done_button, self.other_button, self.resume_button):
            one.setVisible(one in buttons)
        self.show()

    def _allow(self, on: bool) -> None:
        for button in (self.done_button, self.other_button):
            button.setEnabled(on)

    def _answer(self, *, alternative: bool) -> None:
        if self._prompt is not None:
            self._allow(False)
            self.prompt_done.emit(self._prompt.number, alternative)
