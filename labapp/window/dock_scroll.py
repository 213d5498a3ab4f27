"""Scroll areas for docks, so that a small screen cuts no panel."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QObject, QSize, Qt
from PySide6.QtWidgets import QFrame, QScrollArea, QWidget

_LEAST_HEIGHT = 64
"""Height in pixels below which a dock doesn't shrink: two or three lines. Chosen."""


_MOST_HEIGHT = 290
"""Most pixels of a panel that is wanted as a whole. Chosen: all panels fit a screen 720 high."""


class DockScroll(QScrollArea):
    """Show a panel in full width, and let the person scroll where the dock is too low for it.

    With `whole`, the dock doesn't shrink below the panel's height, within limits. The keyboard's
    focus scrolls its field into view.
    """

    def __init__(self, panel: QWidget, parent: QWidget, *, whole: bool = False) -> None:
        super().__init__(parent)
        self._panel, self._whole = panel, whole
        self.setWidgetResizable(True)
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.setWidget(panel)

    def sizeHint(self) -> QSize:
        wanted = self._panel.sizeHint().expandedTo(self._panel.minimumSizeHint())
        return wanted + QSize(self._bar_width, 0)

    def minimumSizeHint(self) -> QSize:
        least, height = self._panel.minimumSizeHint(), _LEAST_HEIGHT
        if self._whole:
            height = max(height, min(least.height(), _MOST_HEIGHT))
        return QSize(least.width() + self._bar_width, height)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        # A panel that needs more room, such as a device with a long name, gets it.
        if watched is self._panel and event.type() == QEvent.Type.LayoutRequest:
            self.updateGeometry()
        return super().eventFilter(watched, event)

    @property
    def _bar_width(self) -> int:
        return self.verticalScrollBar().sizeHint().width()
