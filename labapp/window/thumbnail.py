"""A small grey picture that keeps its aspect ratio."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QRect, QSize, Qt
from PySide6.QtGui import QColor, QImage, QPainter, QPaintEvent
from PySide6.QtWidgets import QSizePolicy, QWidget

from labapp.window.theme import EDGE, FIELD

PSF_DECADES = 4
"""Decades below its peak over which a PSF is shown."""

_OUTDATED = 0.25
"""Opacity of a picture that is no longer of what is chosen. Chosen."""


class Thumbnail(QWidget):
    """Show a grey picture, (rows, columns) uint8, as large as its place, at least `size`."""

    def __init__(self, size: QSize, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._size = size
        self._image: QImage | None = None
        self._outdated = False
        self.setMinimumSize(size)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)

    def sizeHint(self) -> QSize:
        return self._size

    def show_grey(self, grey: NDArray[np.uint8]) -> None:
        rows, columns = grey.shape
        data = np.ascontiguousarray(grey)
        image = QImage(data.data, columns, rows, columns, QImage.Format.Format_Grayscale8)
        # QImage only refers to the array, which is freed on return, so the image is copied.
        self._image = image.copy()
        self.set_outdated(False)

    def show_decades(self, psf: NDArray[np.float32], decades: int) -> None:
        """Show a PSF's logarithm, down to `decades` below the peak."""
        share = np.maximum(psf / psf.max(), 10.0**-decades)
        self.show_grey(np.rint(255 * (np.log10(share) / decades + 1)).astype(np.uint8))

    def set_outdated(self, on: bool) -> None:
        """Set whether the picture is of what was chosen before; it is faint then."""
        self._outdated = on
        self.update()

    def clear(self) -> None:
        self._image = None
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.setPen(QColor(EDGE))
        if self._image is None:
            painter.fillRect(self.rect(), QColor(FIELD))
        else:
            size = self._image.size().scaled(self.size(), Qt.AspectRatioMode.KeepAspectRatio)
            place = QRect(self.rect().topLeft(), size)
            place.moveCenter(self.rect().center())
            painter.setOpacity(_OUTDATED if self._outdated else 1.0)
            painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
            painter.drawImage(place, self._image)
            painter.drawRect(place.adjusted(0, 0, -1, -1))
        painter.end()
