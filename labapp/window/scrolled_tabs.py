"""Tabs whose pages scroll where there is too little room for them."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QFrame, QScrollArea, QTabWidget, QWidget


class ScrolledTabs(QTabWidget):
    """Show one page at a time; a page's size never makes the window larger than its screen.

    Pages are named by the widgets that were added, not by the scroll areas around them.
    """

    def add_scrolled_tab(self, page: QWidget, title: str) -> None:
        """Add a page, with scroll bars where it has too little room."""
        area = QScrollArea(self)
        area.setWidgetResizable(True)
        area.setFrameShape(QFrame.Shape.NoFrame)
        area.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        area.setWidget(page)
        self.addTab(area, title)

    def page(self, index: int) -> QWidget | None:
        """Return the page at an index; None where there is no tab."""
        shown = self.widget(index)
        return shown.widget() if isinstance(shown, QScrollArea) else shown

    def currentWidget(self) -> QWidget | None:  # type: ignore[override]
        return self.page(self.currentIndex())

    def setCurrentWidget(self, page: QWidget) -> None:
        for index in range(self.count()):
            if self.page(index) is page:
                self.setCurrentIndex(index)
