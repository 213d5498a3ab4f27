"""A panel that is never made lower than its texts need."""

from __future__ import annotations

from PySide6.QtCore import QSize
from PySide6.QtWidgets import QWidget


class Panel(QWidget):
    """Texts that wrap need more lines the narrower they are, which a dock doesn't ask about."""

    def minimumSizeHint(self) -> QSize:
        least, layout = super().minimumSizeHint(), self.layout()
        if layout is None or not layout.hasHeightForWidth():
            return least
        width = max(self.width(), least.width())
        return least.expandedTo(QSize(0, layout.minimumHeightForWidth(width)))
