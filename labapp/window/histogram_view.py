"""Logarithmic histogram of a full live frame, with contrast levels to drag."""

from __future__ import annotations

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import QPoint, QPointF, Signal
from PySide6.QtWidgets import QVBoxLayout, QWidget

from labapp.window.theme import ACCENT, EDGE, FAINT, FIELD
from labapp.window.widgets import fill_layout


class HistogramView(QWidget):
    """Plot how many pixels of a frame have each digital number.

    `levels_dragged` is emitted with the levels (black, white) in DN while a person moves them.
    """

    levels_dragged = Signal(float, float)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setFixedHeight(100)
        self.plot = pg.PlotWidget(self, background=FIELD, enableMenu=False)
        self.plot.setMouseEnabled(x=False, y=False)
        self.plot.hideButtons()
        for side in ("bottom", "left"):
            self.plot.getAxis(side).setPen(EDGE)
            self.plot.getAxis(side).setTextPen(FAINT)
        self.plot.getAxis("left").setTicks([[(n, f"1e{n}") for n in (0, 2, 4, 6)]])
        self.plot.getAxis("left").setWidth(34)
        self._curve = self.plot.plot(pen=pg.mkPen(FAINT), stepMode="center", fillLevel=0)
        self._curve.setBrush(pg.mkBrush(EDGE))
        self._levels = pg.LinearRegionItem(
            (0, 1), brush=pg.mkBrush(192, 138, 62, 28), pen=pg.mkPen(ACCENT), swapMode="block"
        )
        self.plot.addItem(self._levels)
        self._levels.sigRegionChanged.connect(self._drag)
        fill_layout(QVBoxLayout(self), self.plot)

    def show_counts(self, counts: NDArray[np.float32], width: float) -> None:
        """Plot counts per bin of `width` DN, summed with their neighbours to at most 512 bins."""
        joined = -(-len(counts) // 512)
        padded = np.pad(counts, (0, -len(counts) % joined))
        columns = padded.reshape(-1, joined).sum(axis=1)
        edges = np.arange(len(columns) + 1) * (joined * width)
        self._curve.setData(edges, np.log10(columns + 1))
        top = float(np.log10(counts.sum() + 1))
        self.plot.setRange(xRange=(0, edges[-1]), yRange=(0, top), padding=0.02)

    def show_levels(self, low: float, high: float) -> None:
        """Show contrast levels, DN, unless a person has a handle in the hand."""
        # Once the mouse is pressed on a handle, it must not move away before the drag begins.
        if self.plot.scene().clickEvents:
            return
        self._levels.blockSignals(True)
        self._levels.setRegion((low, high))
        self._levels.blockSignals(False)

    def handle_position(self, index: int) -> QPoint:
        """Return where the handle of the black (0) or white (1) level is."""
        view = self.plot.getViewBox()
        place = QPointF(self._levels.getRegion()[index], view.viewRange()[1][1] / 2)
        return self.plot.mapFromScene(view.mapViewToScene(place))

    def _drag(self) -> None:
        low, high = self._levels.getRegion()
        self.levels_dragged.emit(float(low), float(high))
