"""Looking at the screen itself."""

from __future__ import annotations

import numpy as np
from PySide6.QtCore import QPoint
from PySide6.QtGui import QImage
from PySide6.QtWidgets import QWidget


def pixels(widget: QWidget) -> np.ndarray:
    """What the X server shows where a widget is, (rows, columns, 3) uint8."""
    top = widget.window()
    place = widget.mapTo(top, QPoint(0, 0))
    size = widget.size()
    shot = top.screen().grabWindow(top.winId(), place.x(), place.y(), size.width(), size.height())
    image = shot.toImage().convertToFormat(QImage.Format.Format_RGB888)
    rows = np.frombuffer(image.constBits(), np.uint8).reshape(image.height(), -1)
    return rows[:, : 3 * image.width()].reshape(image.height(), image.width(), 3).copy()
