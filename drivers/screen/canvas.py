"""The window that covers the panel's screen; only its own process imports this, and so Qt."""

from __future__ import annotations

import os
import time
from typing import Any

from numpy import uint8
from numpy.typing import NDArray
from PySide6.QtCore import QPoint, QRect, Qt
from PySide6.QtGui import (
    QBackingStore,
    QGuiApplication,
    QImage,
    QPainter,
    QRegion,
    QWindow,
)

from drivers.screen.session import disable_scaling
from drivers.x11 import libxcb

_MAP_TIMEOUT = 1.0
"""Seconds in which a window must be on the screen."""


def qt_application(display: str) -> QGuiApplication:
    """Qt of this process, which draws pixel for pixel."""
    running = QGuiApplication.instance()
    if isinstance(running, QGuiApplication):
        return running
    disable_scaling(os.environ, display)
    made = QGuiApplication(["labapp-slm"])
    made.setQuitOnLastWindowClosed(False)
    return made


class Canvas(QWindow):
    """A borderless window over x, y, width and height of the X screen; no cursor is seen on it.

    No window manager places it: it lies where it was put, above others, and takes no keys.
    """

    def __init__(self, region: tuple[int, int, int, int]) -> None:
        super().__init__()
        self.setFlags(
            Qt.WindowType.FramelessWindowHint
            | Qt.WindowType.BypassWindowManagerHint
            | Qt.WindowType.WindowStaysOnTopHint
            | Qt.WindowType.WindowDoesNotAcceptFocus
        )
        self.setTitle("labapp SLM")
        self.setCursor(Qt.CursorShape.BlankCursor)
        x, y, width, height = region
        ratio = self.devicePixelRatio()
        self.setGeometry(
            QRect(round(x / ratio), round(y / ratio), round(width / ratio), round(height / ratio))
        )
        self._store = QBackingStore(self)
        self._image: QImage | None = None
        application: Any = QGuiApplication.instance()
        self._connection = int(application.nativeInterface().connection())

    def appear(self, grey: NDArray[uint8]) -> None:
        """Come up on the screen with this picture."""
        self._image = grey_image(grey)
        self.setVisible(True)
        late = time.monotonic() + _MAP_TIMEOUT
        while not self.isExposed() and time.monotonic() < late:
            QGuiApplication.processEvents()
            time.sleep(0.001)
        self.draw(self._image)

    def draw(self, image: QImage) -> None:
        """Show a picture; it is with the X server on return."""
        self._image = image
        self._flush()
        libxcb.round_trip(self._connection)

    def _flush(self) -> None:
        if self._image is None:
            return
        self._store.resize(self.size())
        whole = QRegion(QRect(QPoint(0, 0), self.size()))
        self._image.setDevicePixelRatio(self.devicePixelRatio())
        self._store.beginPaint(whole)
        painter = QPainter(self._store.paintDevice())
        painter.setCompositionMode(QPainter.CompositionMode.CompositionMode_Source)
        painter.drawImage(QPoint(0, 0), self._image)
        painter.end()
        self._store.endPaint()
        self._store.flush(whole)

    def exposeEvent(self, event: object) -> None:
        """Another window lay on top, and the server has forgotten what was below."""
        if self.isExposed():
            self._flush()


def grey_image(grey: NDArray[uint8]) -> QImage:
    """A picture in the array's own memory, which must live as long."""
    rows, columns = grey.shape
    image = QImage(grey.data, columns, rows, columns, QImage.Format.Format_Grayscale8)
    image.setColorSpace(type(image.colorSpace())())
    return image
