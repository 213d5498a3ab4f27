"""A panel that is never made lower than its texts need."""

from __future__ import annotations

from PySide6.QtCore import QSize
from PySide6.QtWidgets import QWidget


class Panel(QWidget):
    """Texts that wrap need more lines the narrower they are, which a dock doesn't ask about."""

    def minimumSizeHint(self) -> QSize:
        least = super().minimumSizeHint()
        width = max(self.width(), least.width())
        return QSize(least.width(), max(least.height(), self.heightForWidth(width)))
