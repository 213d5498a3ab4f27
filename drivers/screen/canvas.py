"""The Qt window that covers the SLM; only its own process imports this module."""

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


def qt_application(display: str) -> QGuiApplication:
    """Return this process's Qt application, which draws pixel for pixel on the X display."""
    running = QGuiApplication.instance()
    if isinstance(running, QGuiApplication):
        return running
    disable_scaling(os.environ, display)
    made = QGuiApplication(["labapp-slm"])
    made.setQuitOnLastWindowClosed(False)
    return made


class Canvas(QWindow):
    """Show pictures in a borderless window over a region (x, y, width, height), in pixels.

    The window hides the cursor, bypasses the window manager, stays above other windows, and
    doesn't take the keyboard focus.
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
        """Show the window with a picture."""
        self._image = grey_image(grey)
        self.setVisible(True)
        # Seconds within which the X server must have mapped the window.
        late = time.monotonic() + 1.0
        while not self.isExposed() and time.monotonic() < late:
            QGuiApplication.processEvents()
            time.sleep(0.001)
        self.draw(self._image)

    def draw(self, image: QImage) -> None:
        """Draw a picture; on return, the X server has received it."""
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
        """Redraw the picture after another window covered this one; Qt calls this."""
        if self.isExposed():
            self._flush()


def grey_image(grey: NDArray[uint8]) -> QImage:
    """Wrap grey levels as a QImage that shares the array's memory.

    The array must outlive the image.
    """
    rows, columns = grey.shape
    image = QImage(grey.data, columns, rows, columns, QImage.Format.Format_Grayscale8)
    image.setColorSpace(type(image.colorSpace())())
    return image
