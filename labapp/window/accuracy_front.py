"""Plot of predicted error against time in the tab "Accuracy", with the choice marked."""

from __future__ import annotations

import math
from itertools import pairwise

import pyqtgraph as pg
from PySide6.QtWidgets import QVBoxLayout, QWidget

from labapp.window.messages import AccuracyForecast, AccuracyPoint
from labapp.window.theme import ACCENT, EDGE, FAINT, FIELD, TEXT
from labapp.window.widgets import fill_layout

_LEAST = 1e-16
"""Least error that the plot shows."""


class AccuracyFront(QWidget):
    """Plot all predicted methods, the front, the automatic choices, and the present setting."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setMinimumHeight(150)
        self._plot = pg.PlotWidget(self, background=FIELD, enableMenu=False)
        self._plot.setMouseEnabled(x=False, y=False)
        self._plot.hideButtons()
        for side, text in (("bottom", "time of each PSF"), ("left", "predicted error")):
            axis = self._plot.getAxis(side)
            axis.setPen(EDGE)
            axis.setTextPen(FAINT)
            axis.setLabel(text, color=FAINT)
            axis.setTicks([[]])
        self._plot.getAxis("left").setWidth(62)
        legend = self._plot.addLegend(offset=(-8, 8), labelTextColor=TEXT, labelTextSize="9pt")
        legend.setBrush(FIELD)
        self._all = self._plot.plot(
            pen=None, symbol="o", symbolSize=5, symbolBrush=EDGE, symbolPen=None,
            name="other methods",
        )  # fmt: skip
        self._front = self._plot.plot(pen=pg.mkPen(FAINT, width=1), name="front")
        self._chosen = self._plot.plot(
            pen=None, symbol="o", symbolSize=10, symbolBrush=None,
            symbolPen=pg.mkPen(TEXT, width=1.4), name="automatic choice",
        )  # fmt: skip
        self._present = self._plot.plot(
            pen=None, symbol="star", symbolSize=17, symbolBrush=ACCENT, symbolPen=None,
            name="present setting",
        )  # fmt: skip
        fill_layout(QVBoxLayout(self), self._plot)

    def show_forecast(self, forecast: AccuracyForecast) -> None:
        """Plot what each tolerance is predicted to cost."""
        good = [one for one in forecast.points if one.error is not None and one.each_seconds]
        self._all.setData(*_places(good))
        self._chosen.setData(*_places([one for one in good if one.chosen]))
        front = sorted(zip(*_places([one for one in good if one.on_front]), strict=True))
        steps = [place for pair in pairwise(front) for place in _step(*pair)]
        steps += front[-1:]
        self._front.setData([x for x, _ in steps], [y for _, y in steps])
        if not good:
            return
        x, y = _places(good)
        for side, values, name in (("bottom", x, _seconds_text), ("left", y, _error_text)):
            low, high = math.floor(min(values)), math.ceil(max(values))
            every = max(1, (high - low) // 6)
            ticks = [(k, name(k)) for k in range(low, high + 1, every)]
            fine = [
                (k + math.log10(part), name(k + math.log10(part)))
                for k in range(low, high)
                for part in (2, 5)
            ]
            self._plot.getAxis(side).setTicks([ticks + (fine if high - low <= 2 else [])])
        self._plot.setRange(
            xRange=(min(x) - 0.15, max(x) + 0.15), yRange=(min(y), max(y)), padding=0.08
        )

    def show_present(self, point: AccuracyPoint | None) -> None:
        """Mark the present setting; None removes the mark."""
        shown = [] if point is None or point.error is None or not point.each_seconds else [point]
        self._present.setData(*_places(shown))

    @property
    def present_place(self) -> tuple[float, float] | None:
        """Return where the present setting is marked: log10 of its seconds and of its error."""
        x, y = self._present.getData()
        return None if x is None or not len(x) else (float(x[0]), float(y[0]))


def _places(points: list[AccuracyPoint]) -> tuple[list[float], list[float]]:
    """Return log10 of the points' seconds and of their errors."""
    return (
        [math.log10(one.each_seconds or 1.0) for one in points],
        [math.log10(max(one.error or 0.0, _LEAST)) for one in points],
    )


def _step(
    here: tuple[float, float], there: tuple[float, float]
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the corner points of the front's step from one setting to the next."""
    return here, (there[0], here[1])


def _seconds_text(power: float) -> str:
    seconds = 10.0**power
    return f"{1e3 * seconds:.3g} ms" if seconds < 0.9995 else f"{seconds:.3g} s"


def _error_text(power: float) -> str:
    return f"1e{power:.0f}" if power == int(power) else ""
