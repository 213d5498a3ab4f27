"""Show a label with number and name on each screen; this needs Qt in a separate process."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PySide6.QtCore import QRect, Qt
from PySide6.QtGui import QColor, QFont, QGuiApplication, QImage, QPainter

from drivers.interfaces import Clock
from drivers.screen.canvas import Canvas, qt_application
from drivers.x11.outputs import Output


def show_labels(display: str, there: Sequence[Output], clock: Clock, seconds: float) -> None:
    """Show a label in the middle of each output for some seconds."""
    qt_application(display)
    plates = []
    for number, output in enumerate(there, 1):
        width, height = min(480, output.width), min(240, output.height)
        left = output.x + (output.width - width) // 2
        top = output.y + (output.height - height) // 2
        plate = Canvas((left, top, width, height))
        plate.appear(np.zeros((height, width), np.uint8))
        plate.draw(_render_label(number, output, width, height))
        plates.append(plate)
    end = clock.now() + seconds
    while clock.now() < end:
        QGuiApplication.processEvents()
        clock.wait_until(min(end, clock.now() + 0.05), lambda: False)
    for plate in plates:
        plate.destroy()


def _render_label(number: int, output: Output, width: int, height: int) -> QImage:
    image = QImage(width, height, QImage.Format.Format_RGB32)
    image.fill(QColor("black"))
    painter = QPainter(image)
    painter.setPen(QColor("white"))
    painter.drawRect(0, 0, width - 1, height - 1)
    middle = Qt.AlignmentFlag.AlignCenter
    for words, top, size in (
        (str(number), 0.0, 0.45),
        (output.name, 0.45, 0.2),
        (output.monitor.model or f"{output.width}x{output.height}", 0.68, 0.14),
    ):
        font = QFont()
        font.setPixelSize(max(1, int(size * height * 0.8)))
        painter.setFont(font)
        place = QRect(0, int(top * height), width, int(size * height))
        painter.drawText(place, middle, words)
    painter.end()
    return image
