"""A view of a picture that can be zoomed and moved, without smoothing."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import QPointF, QSize, Qt, Signal
from PySide6.QtWidgets import QVBoxLayout, QWidget

from labapp.window.theme import FIELD, TEXT
from labapp.window.widgets import fill_layout


class PictureView(QWidget):
    """Show a picture through a palette; a double click fits it to the view again.

    `pixel_hovered` is emitted with the row and column under the mouse, (-1, -1) outside the
    picture; `pixel_clicked` with those of a single click within it.
    """

    pixel_hovered = Signal(int, int)
    pixel_clicked = Signal(int, int)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._view = pg.GraphicsView(self, background=FIELD)
        self.box = pg.ViewBox(lockAspect=True, invertY=True, enableMenu=False)
        self._view.setCentralItem(self.box)
        self._item = pg.ImageItem(axisOrder="row-major")
        self.box.addItem(self._item)
        self._mark = pg.ScatterPlotItem(symbol="+", size=17, pen=pg.mkPen(FIELD), brush=TEXT)
        self._mark.setZValue(5)
        self.box.addItem(self._mark, ignoreBounds=True)
        self._shape = (0, 0)
        fill_layout(QVBoxLayout(self), self._view)
        scene = self._view.scene()
        scene.sigMouseMoved.connect(self._hover)
        scene.sigMouseClicked.connect(self._click)

    def sizeHint(self) -> QSize:
        return QSize(320, 200)

    def show_indices(self, indices: NDArray[np.uint8], palette: NDArray[np.uint8]) -> None:
        """Show a picture of palette indices, (rows, columns) uint8.

        A picture of (rows, columns, 3) has colours of its own.
        palette: colours, (256, 3).
        """
        lut = palette if indices.ndim == 2 else None
        self._item.setImage(indices, levels=(0, 255), lut=lut, autoLevels=False)
        if indices.shape[:2] != self._shape:
            self._shape = (indices.shape[0], indices.shape[1])
            self.fit()

    def fit(self) -> None:
        rows, columns = self._shape
        self.box.setRange(xRange=(0, columns), yRange=(0, rows), padding=0)

    def show_true_size(self) -> None:
        """Show a pixel of the picture on each pixel of the screen, about the middle of the view."""
        (left, right), (top, bottom) = self.box.viewRange()
        scale = self.devicePixelRatioF()
        x, y = (left + right) / 2, (top + bottom) / 2
        across, down = self.box.width() * scale / 2, self.box.height() * scale / 2
        self.box.setRange(xRange=(x - across, x + across), yRange=(y - down, y + down), padding=0)

    @property
    def reduction(self) -> int:
        """Return how many picture pixels share a pixel of the screen along an axis, at least 1."""
        width, height = self.box.viewPixelSize()
        # The tolerance of 0.01 gives a picture at its own size 1, despite rounding errors.
        return max(1, math.ceil(max(width, height) - 0.01))

    def link(self, other: PictureView) -> None:
        """Link this picture to another one: both zoom and move together."""
        self.box.setXLink(other.box)
        self.box.setYLink(other.box)

    def mark_pixel(self, row: int, column: int) -> None:
        """Draw a cross on a pixel, in the place of an earlier one."""
        self._mark.setData([column + 0.5], [row + 0.5])

    def pixel_position(self, row: int, column: int) -> QPointF:
        """Return where the centre of a picture's pixel is on this widget."""
        scene = self.box.mapViewToScene(QPointF(column + 0.5, row + 0.5))
        return QPointF(self._view.mapFromScene(scene))

    def _hover(self, position: Any) -> None:
        self.pixel_hovered.emit(*(self._pixel_at(position) or (-1, -1)))

    def _click(self, event: Any) -> None:
        if event.button() != Qt.MouseButton.LeftButton:
            return
        if event.double():
            self.fit()
        elif (pixel := self._pixel_at(event.scenePos())) is not None:
            self.pixel_clicked.emit(*pixel)

    def _pixel_at(self, position: Any) -> tuple[int, int] | None:
        """Return the picture's pixel at a place of the view's scene; None outside the picture."""
        point = self.box.mapSceneToView(position)
        row, column = int(np.floor(point.y())), int(np.floor(point.x()))
        inside = 0 <= row < self._shape[0] and 0 <= column < self._shape[1]
        return (row, column) if inside else None
