"""Modal dialogues that a test doesn't expect: nobody would answer them."""

from __future__ import annotations

from calls import innermost_call
from PySide6.QtWidgets import QApplication, QDialog, QLabel, QMessageBox, QWidget

_unexpected: list[str] = []
"""What dialogues of this test said."""


class UnexpectedDialogue(AssertionError):
    """A dialogue waited for somebody, and nobody was there."""


def close_any() -> None:
    """Close the dialogue that waits, if one does, without an answer; its words are kept."""
    widget = QApplication.activeModalWidget()
    if widget is None:
        return
    opening = innermost_call("dialogues.py", "watchdog.py")
    _unexpected.append(f"{_words(widget)}, opened by {opening}")
    if isinstance(widget, QDialog):
        # A class's own reject() may ask once more.
        QDialog.done(widget, QDialog.DialogCode.Rejected)
    else:
        widget.close()


def require_none() -> None:
    """UnexpectedDialogue, with its words, if there was one since forget()."""
    if _unexpected:
        raise UnexpectedDialogue(_report())


def note_on(error: BaseException) -> None:
    """Have an error tell of dialogues that may have led to it."""
    if _unexpected and not isinstance(error, UnexpectedDialogue):
        error.add_note(_report())


def forget() -> None:
    _unexpected.clear()


def _report() -> str:
    return "nobody expected a dialogue: " + "; ".join(_unexpected)


def _words(widget: QWidget) -> str:
    if isinstance(widget, QMessageBox):
        said = [widget.text(), widget.informativeText()]
    else:
        said = [label.text() for label in widget.findChildren(QLabel)]
    title = widget.windowTitle() or type(widget).__name__
    return f"{title!r} says {' '.join(words for words in said if words)!r}"
