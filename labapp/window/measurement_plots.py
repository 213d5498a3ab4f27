"""Plots of star width and focus score over time, and of numbers along a line."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QVBoxLayout, QWidget

from labapp.window.focus_history import FocusHistory
from labapp.window.measuring_messages import LineReading
from labapp.window.theme import ACCENT, EDGE, FAINT, FIELD, REAL
from labapp.window.widgets import fill_layout, make_label

_HEIGHT = 84
"""Height of a plot in pixels. Chosen: three of them fit a small screen beside the picture."""

_LEFT = 46
"""Width of the axis with the numbers in pixels, the same in all plots so that times stand one
above the other. Chosen."""


_LEAST_SPAN = 10.0
"""Least seconds that a course over time shows. Chosen: single measurements can be told apart."""


class SmallPlot(QWidget):
    """Plot one quantity in a little room, under a title; None leaves a gap."""

    def __init__(self, title: str, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.title = make_label(self, title, look="faint")
        self._plot = pg.PlotWidget(self, background=FIELD, enableMenu=False)
        self._plot.setMouseEnabled(x=False, y=False)
        self._plot.hideButtons()
        self._plot.setFixedHeight(_HEIGHT)
        self._plot.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        for side in ("bottom", "left"):
            self._plot.getAxis(side).setPen(EDGE)
            self._plot.getAxis(side).setTextPen(FAINT)
        self._plot.getAxis("left").setWidth(_LEFT)
        self._curve = self._plot.plot(pen=pg.mkPen(ACCENT), connect="finite")
        self._best = pg.InfiniteLine(angle=0, pen=pg.mkPen(REAL, style=Qt.PenStyle.DashLine))
        self._best.hide()
        self._plot.addItem(self._best)
        fill_layout(QVBoxLayout(self), self.title, self._plot, spacing=1)

    def show_curve(self, x: Sequence[float], y: Sequence[float | None]) -> None:
        values = np.array([np.nan if one is None else one for one in y], dtype=np.float64)
        self._curve.setData(np.asarray(x, dtype=np.float64), values)

    def show_best(self, value: float | None) -> None:
        """Show the best value as a dashed line; None shows none."""
        self._best.setVisible(value is not None)
        if value is not None:
            self._best.setValue(value)

    @property
    def values(self) -> list[float]:
        """Return the values of the curve, without gaps."""
        y = self._curve.getData()[1]
        return [] if y is None else [float(one) for one in y if np.isfinite(one)]

    def show_span(self, low: float, high: float) -> None:
        """Set the ends of the axis along which the curve runs."""
        self._plot.setXRange(low, high, padding=0)


class FocusPlots(QWidget):
    """Plot star width and focus score over the last seconds, each with its best value."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.fwhm = SmallPlot("Star width (FWHM) in pixels over the last seconds", self)
        self.focus = SmallPlot("Focus score in 1/pixel² over the last seconds", self)
        fill_layout(QVBoxLayout(self), self.fwhm, self.focus, spacing=4)

    def show_history(self, history: FocusHistory) -> None:
        """Show the course of measurements, the last one at the right."""
        points = history.points
        last = points[-1].taken_at if points else 0.0
        times = [point.taken_at - last for point in points]
        span = max(_LEAST_SPAN, -times[0]) if times else _LEAST_SPAN
        self.fwhm.show_curve(times, [point.fwhm for point in points])
        self.focus.show_curve(times, [point.focus for point in points])
        for plot in (self.fwhm, self.focus):
            plot.show_span(-span, 0)
        self.fwhm.show_best(history.best_fwhm)
        self.focus.show_best(history.best_focus)


class ProfilePlot(SmallPlot):
    """Plot the digital numbers along the line in the picture."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__("Digital numbers along the line, over pixels from its start", parent)

    def show_line(self, line: LineReading | None) -> None:
        """Show the numbers along a line; None clears the plot."""
        if line is None:
            self.show_curve([], [])
            return
        self.show_curve(line.distances.tolist(), line.values.tolist())
        self.show_span(0, max(float(line.distances[-1]), 1.0))
