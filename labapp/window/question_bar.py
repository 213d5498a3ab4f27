"""Bar for a question that only a click or Ctrl+Enter answers with yes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QHBoxLayout, QPushButton, QWidget

from labapp.window.actions import Action, retitle
from labapp.window.widgets import STOPS, fill_layout, make_label, make_tool_button


@dataclass(frozen=True)
class Question:
    """A question, and what follows from the answers.

    subject: what it is about.
    yes, no: the words on the buttons.
    """

    subject: str
    text: str
    yes: str
    no: str
    on_yes: Callable[[], None]
    on_no: Callable[[], None] = lambda: None


class QuestionBar(QWidget):
    """Ask the person one question at a time above the picture; a newer one replaces it.

    The window goes on meanwhile. Enter and Space don't answer, and Esc says no: keys that are
    pressed by mistake do nothing that can't be undone.
    """

    def __init__(self, yes: Action, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("call")
        self.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)
        self._label = make_label(self, wrap=True)
        self._yes = yes
        self.yes_button = make_tool_button(self, yes)
        self.no_button = QPushButton(self)
        self.no_button.setProperty(STOPS, True)
        self._question: Question | None = None
        parts = (self._label, 1), self.yes_button, self.no_button
        fill_layout(QHBoxLayout(self), *parts, margins=(10, 6, 6, 6))
        yes.performed.connect(lambda: self._answer(True))
        self.no_button.clicked.connect(self.decline)
        self._show(None)

    @property
    def text(self) -> str:
        return self._label.text() if self._question else ""

    @property
    def subject(self) -> str:
        """Return what the question is about; empty if nothing is asked."""
        return self._question.subject if self._question else ""

    def ask(self, question: Question) -> None:
        """Ask a question; one that is open is declined."""
        self.decline()
        self._show(question)

    def decline(self) -> None:
        """Answer the question with no, if one is open."""
        self._answer(False)

    def withdraw(self, subject: str) -> None:
        """Take the question about a subject back without an answer."""
        if self.subject == subject:
            self._show(None)

    def _answer(self, yes: bool) -> None:
        question = self._question
        if question is None:
            return
        self._show(None)
        (question.on_yes if yes else question.on_no)()

    def _show(self, question: Question | None) -> None:
        self._question = question
        self._yes.setEnabled(question is not None)
        self.setVisible(question is not None)
        if question is not None:
            self._label.setText(question.text)
            retitle(self._yes, question.yes)
            self.no_button.setText(f"{question.no}  Esc")
