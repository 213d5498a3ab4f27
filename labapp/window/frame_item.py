"""The item of a picture view that paints a reduced frame, pixel for pixel of the screen."""

from __future__ import annotations

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import QPointF, QRectF, Signal
from PySide6.QtGui import QImage, QPainter
from PySide6.QtWidgets import QStyleOptionGraphicsItem, QWidget

from labapp.window.frame_reduction import ReducedFrame


class FrameItem(pg.GraphicsObject):  # type: ignore[misc]
    """Paint what is shown of a frame where its pixels lie in the view.

    A picture that was reduced for the present view is painted without scaling. Any other one is
    scaled without smoothing. `painted` is emitted after each painting.
    """

    painted = Signal()

    def __init__(self) -> None:
        super().__init__()
        self._shape = (0, 0)
        self._shown: ReducedFrame | None = None
        self._colours: list[int] = []
        self._image: QImage | None = None

    def show_reduced(
        self, shown: ReducedFrame, shape: tuple[int, int], palette: NDArray[np.uint8]
    ) -> None:
        """Show a reduced frame of a whole one of `shape` (rows, columns), in (256, 3) colours."""
        if shape != self._shape:
            self.prepareGeometryChange()
            self._shape = shape
        red, green, blue = palette.astype(np.uint32).T
        self._colours = (0xFF000000 | red << 16 | green << 8 | blue).tolist()
        self._shown, self._image = shown, None
        self.update()

    def boundingRect(self) -> QRectF:
        return QRectF(0, 0, self._shape[1], self._shape[0])

    def paint(
        self, painter: QPainter, option: QStyleOptionGraphicsItem, widget: QWidget | None = None
    ) -> None:
        if self._shown is None:
            return
        row, column, rows, columns = self._shown.region
        place = painter.worldTransform().mapRect(QRectF(column, row, columns, rows))
        density = painter.device().devicePixelRatioF()
        image = self._coloured_image(self._shown.indices)
        painter.save()
        painter.resetTransform()
        if _fits(image, place, density):
            # Without a transformation, Qt copies the pixels, which is several times faster.
            image.setDevicePixelRatio(density)
            corner = QPointF(round(place.x() * density), round(place.y() * density)) / density
            painter.drawImage(corner, image)
        else:
            image.setDevicePixelRatio(1.0)
            painter.drawImage(place, image)
        painter.restore()
        self.painted.emit()

    def _coloured_image(self, indices: NDArray[np.uint8]) -> QImage:
        """Return the picture in the screen's colours, converted once for each picture."""
        if self._image is None:
            rows, columns = indices.shape
            data = np.ascontiguousarray(indices)
            image = QImage(data.data, columns, rows, columns, QImage.Format.Format_Indexed8)
            image.setColorTable(self._colours)
            # The converted image has memory of its own: the engine may write the array's again.
            self._image = image.convertToFormat(QImage.Format.Format_RGB32)
        return self._image


def _fits(image: QImage, place: QRectF, density: float) -> bool:
    """Return whether the picture has as many pixels as its place on the screen."""
    wide, high = place.width() * density, place.height() * density
    return abs(image.width() - wide) < 1 and abs(image.height() - high) < 1
