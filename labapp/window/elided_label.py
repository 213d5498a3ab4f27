"""Labels whose text is shortened where it doesn't fit."""

from __future__ import annotations

from PySide6.QtCore import QSize, Qt
from PySide6.QtGui import QFont, QFontMetrics, QResizeEvent, QTextLayout, QTextOption
from PySide6.QtWidgets import QLabel, QWidget

from labapp.window.widgets import plain_tip

_LEAST_CHARACTERS = 4
"""Average characters that such a label shows at least. Chosen."""


class ElidedLabel(QLabel):
    """Show a text in at most `lines` lines; what doesn't fit ends in "…" and is in the tool tip.

    `text()` is the whole text. The label never makes the window wider.
    """

    def __init__(self, parent: QWidget | None = None, *, lines: int = 1, look: str = "") -> None:
        super().__init__(parent)
        self.setTextFormat(Qt.TextFormat.PlainText)
        self.setObjectName(look)
        self._lines = lines
        self._whole = ""

    def text(self) -> str:
        return self._whole

    def setText(self, text: str) -> None:
        self._whole = text
        self._fit()
        self.updateGeometry()

    @property
    def is_elided(self) -> bool:
        """Return whether less than the whole text is shown."""
        return super().text().replace("\n", " ").strip() != " ".join(self._whole.split())

    def sizeHint(self) -> QSize:
        metrics = self.fontMetrics()
        frame = self._frame_size()
        width = metrics.horizontalAdvance(self._whole) // self._lines + frame.width() + 2
        return QSize(width, self._lines * metrics.lineSpacing() + frame.height())

    def minimumSizeHint(self) -> QSize:
        metrics = self.fontMetrics()
        width = _LEAST_CHARACTERS * metrics.averageCharWidth() + self._frame_size().width()
        return QSize(width, metrics.lineSpacing() + self._frame_size().height())

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self._fit()

    def _frame_size(self) -> QSize:
        """Return what margins and the style sheet's padding take of the label."""
        return super().sizeHint() - QFontMetrics(self.font()).size(0, super().text() or "x")

    def _fit(self) -> None:
        room = self.contentsRect()
        lines = max(1, min(self._lines, room.height() // self.fontMetrics().lineSpacing()))
        shown = shorten(self._whole, self.font(), room.width() - 2 * self.margin(), lines)
        super().setText(shown)
        self.setToolTip(plain_tip(self._whole) if self.is_elided else "")


def shorten(text: str, font: QFont, width: int, lines: int) -> str:
    """Break a text into at most `lines` lines of `width` pixels, the last one elided.

    Blanks and line breaks of the text count as one blank each.
    """
    words, metrics = " ".join(text.split()), QFontMetrics(font)
    if lines == 1:
        return metrics.elidedText(words, Qt.TextElideMode.ElideRight, width)
    option = QTextOption()
    option.setWrapMode(QTextOption.WrapMode.WrapAtWordBoundaryOrAnywhere)
    layout = QTextLayout(words, font)
    layout.setTextOption(option)
    layout.beginLayout()
    shown: list[str] = []
    while (line := layout.createLine()).isValid():
        line.setLineWidth(width)
        start = line.textStart()
        if len(shown) == lines - 1:
            shown.append(metrics.elidedText(words[start:], Qt.TextElideMode.ElideRight, width))
            break
        shown.append(words[start : start + line.textLength()].rstrip())
    layout.endLayout()
    return "\n".join(shown)
