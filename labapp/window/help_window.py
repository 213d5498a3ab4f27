"""The help window, which shows the guide: topics on the left, the page on the right."""

from __future__ import annotations

from typing import Any

from PySide6.QtCore import QBuffer, QByteArray, QIODevice, QSize, Qt, QTimer, QUrl
from PySide6.QtGui import (
    QColor,
    QDesktopServices,
    QImage,
    QImageReader,
    QTextBlock,
    QTextCursor,
    QTextDocument,
    QTextFormat,
)
from PySide6.QtWidgets import (
    QDialog,
    QHBoxLayout,
    QListWidget,
    QListWidgetItem,
    QTextBrowser,
    QWidget,
)

from labapp.common.guide import PAGES, list_topics
from labapp.window import theme
from labapp.window.widgets import fill_layout

_SIZE = QSize(1160, 760)
_MARGIN = 18
"""Margin in pixels around a page of the guide, before its code, and beside the topics' titles."""


class PageView(QTextBrowser):
    """Show a page of the guide: pictures are at most as wide as the view, code has a background."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setOpenLinks(False)
        self.setSearchPaths([str(PAGES)])
        self.document().setDocumentMargin(_MARGIN)

    def loadResource(self, kind: int, name: QUrl | str) -> Any:
        found = super().loadResource(kind, name)
        if kind != QTextDocument.ResourceType.ImageResource.value or found is None:
            return found
        # Leave room for a scroll bar, which may not be shown yet.
        room = self.width() - 2 * self.frameWidth() - 3 * _MARGIN
        return _read_image(QByteArray(found), room)

    def show_page(self, markdown: str) -> None:
        self.setMarkdown(markdown)
        block = self.document().begin()
        while block.isValid():
            if block.blockFormat().hasProperty(QTextFormat.Property.BlockCodeFence):
                _set_off(block)
            block = block.next()


def _read_image(data: QByteArray, room: int) -> QImage:
    """Read a picture of the guide, at most `room` pixels wide.

    The reader makes a photograph smaller in a part of the time that reading it whole takes.
    """
    buffer = QBuffer(data)
    buffer.open(QIODevice.OpenModeFlag.ReadOnly)
    reader = QImageReader(buffer)
    size = reader.size()
    if size.width() > room:
        reader.setScaledSize(QSize(room, round(size.height() * room / size.width())))
    return reader.read()


def _set_off(code: QTextBlock) -> None:
    form = code.blockFormat()
    form.setBackground(QColor(theme.FIELD))
    form.setLeftMargin(form.leftMargin() + _MARGIN)
    QTextCursor(code).setBlockFormat(form)


class HelpWindow(QDialog):
    """Show the guide beside the main window, which stays usable."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWindowTitle("labapp: guide")
        self.topics = QListWidget(self)
        self.page = PageView(self)
        row = QHBoxLayout(self)
        fill_layout(row, self.topics, (self.page, 1), margins=(8, 8, 8, 8), spacing=8)
        self._pages = list_topics()
        for one in self._pages:
            item = QListWidgetItem(one.title, self.topics)
            item.setToolTip(one.summary)
        # The list of topics is as wide as its longest title.
        self.topics.setFixedWidth(self.topics.sizeHintForColumn(0) + _MARGIN)
        self.topics.currentRowChanged.connect(self._show_row)
        self.page.anchorClicked.connect(self._follow)
        self.resize(_SIZE)
        # Pictures are fitted to the view, whose width is known once the layout is active.
        row.activate()
        # The empty window is shown first, since a page takes long to lay out.
        QTimer.singleShot(0, self._show_first_page)

    def show_topic(self, name: str) -> None:
        """Show the guide's page on a topic, if there is one."""
        for row, one in enumerate(self._pages):
            if one.name == name:
                self.topics.setCurrentRow(row)

    def _show_first_page(self) -> None:
        """Show the first page, if no other was asked for; keys choose topics."""
        if self.topics.currentRow() < 0:
            self.topics.setCurrentRow(0)
        self.topics.setFocus(Qt.FocusReason.OtherFocusReason)

    def _show_row(self, row: int) -> None:
        self.page.show_page(self._pages[row].text)

    def _follow(self, link: QUrl) -> None:
        """Open a link: the guide's pages here, web addresses in the browser."""
        if link.scheme() in ("http", "https"):
            QDesktopServices.openUrl(link)
        elif link.fileName().endswith(".md"):
            self.show_topic(link.fileName().removesuffix(".md"))
