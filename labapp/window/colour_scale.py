"""Palettes of maps, and the scale that says which value has which colour."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QRect, QSize, Qt
from PySide6.QtGui import QColor, QImage, QPainter, QPaintEvent
from PySide6.QtWidgets import QSizePolicy, QWidget

from labapp.window.theme import EDGE, TEXT

_RISING = ((16, 17, 19), (110, 72, 28), (226, 160, 70), (255, 236, 200))
"""Colours from nothing to much. Red is left to errors and saturated pixels."""

_SIGNED = ((150, 205, 255), (40, 100, 190), (16, 17, 19), (190, 120, 40), (255, 214, 140))
"""Colours from too little, over nothing in the middle, to too much."""

_BAR = QSize(110, 10)
"""Size of the scale's bar in pixels of the screen."""

_GAP = 6


def rising_palette() -> NDArray[np.uint8]:
    """Return the palette for values from 0 upwards, (256, 3)."""
    return _interpolate(_RISING)


def signed_palette() -> NDArray[np.uint8]:
    """Return the palette for values around 0, (256, 3); the middle is dark."""
    return _interpolate(_SIGNED)


class ColourScale(QWidget):
    """Show a palette as a bar between the values of its ends."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._image: QImage | None = None
        self._low = self._high = ""
        self.setSizePolicy(QSizePolicy.Policy.Fixed, QSizePolicy.Policy.Preferred)

    def show_scale(self, palette: NDArray[np.uint8], lowest: float, highest: float) -> None:
        """Show a palette whose ends stand for two values."""
        data = np.ascontiguousarray(palette)
        # QImage only refers to the array, which is freed on return, so the image is copied.
        self._image = QImage(data.data, len(data), 1, 3 * len(data), QImage.Format.Format_RGB888)
        self._image = self._image.copy()
        sign = "+" if lowest < 0 else ""
        self._low, self._high = f"{lowest:g}".replace("-", "−"), f"{sign}{highest:g}"
        self.updateGeometry()
        self.update()

    def sizeHint(self) -> QSize:
        metrics = self.fontMetrics()
        text = sum(metrics.horizontalAdvance(one) for one in (self._low, self._high))
        return QSize(_BAR.width() + text + 2 * _GAP, metrics.height())

    def minimumSizeHint(self) -> QSize:
        return self.sizeHint()

    def paintEvent(self, event: QPaintEvent) -> None:
        if self._image is None:
            return
        painter = QPainter(self)
        left = self.fontMetrics().horizontalAdvance(self._low) + _GAP
        bar = QRect(left, (self.height() - _BAR.height()) // 2, _BAR.width(), _BAR.height())
        painter.setPen(QColor(TEXT))
        side = Qt.AlignmentFlag.AlignVCenter
        painter.drawText(self.rect(), side | Qt.AlignmentFlag.AlignLeft, self._low)
        painter.drawText(self.rect(), side | Qt.AlignmentFlag.AlignRight, self._high)
        painter.drawImage(bar, self._image)
        painter.setPen(QColor(EDGE))
        painter.drawRect(bar)
        painter.end()


def _interpolate(colours: tuple[tuple[int, int, int], ...]) -> NDArray[np.uint8]:
    """Interpolate some colours evenly to a palette, (256, 3)."""
    at = np.linspace(0, 255, len(colours))
    channels = [np.interp(np.arange(256), at, one) for one in np.transpose(colours)]
    return np.rint(np.stack(channels, axis=1)).astype(np.uint8)
