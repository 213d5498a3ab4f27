"""A pixel's restored spectrum, with its error, beside the true spectrum."""

from __future__ import annotations

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtWidgets import QVBoxLayout, QWidget

from labapp.window.theme import ACCENT, EDGE, FAINT, FIELD, TEXT
from labapp.window.widgets import fill_layout

_MOST_TICKS = 8
"""Most bands whose wavelengths are all written below the plot; of more, round numbers are."""

_MARGIN_NM = 12.0
"""Room in nanometres beside the first and the last band."""

_LEAST, _MOST = 0.02, 1.18
"""Room below 0 and up to the top, over the highest value: points at 0 are seen whole, and the
legend lies above the curves."""

Spectrum = NDArray[np.float32]


class SpectrumPlot(QWidget):
    """Plot shares of white by wavelength for one pixel of a cube, and mark the chosen band."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._plot = pg.PlotWidget(self, background=FIELD, enableMenu=False)
        self._plot.setMouseEnabled(x=False, y=False)
        self._plot.hideButtons()
        for side, text in (("bottom", "wavelength in nm"), ("left", "share of white")):
            axis = self._plot.getAxis(side)
            axis.setPen(EDGE)
            axis.setTextPen(FAINT)
            axis.setLabel(text, color=FAINT)
        self._plot.getAxis("left").setWidth(54)
        self._plot.showGrid(y=True, alpha=0.15)
        self._nm = np.zeros(0)
        self._band = pg.InfiniteLine(0, angle=90, pen=pg.mkPen(FAINT, width=1))
        self._ends = [pg.PlotCurveItem(pen=pg.mkPen(None)) for _ in range(2)]
        self._error = pg.FillBetweenItem(*self._ends, brush=pg.mkBrush(192, 138, 62, 70))
        for item in (self._band, *self._ends, self._error):
            self._plot.addItem(item, ignoreBounds=True)
        self._truth = self._plot.plot(
            pen=pg.mkPen(TEXT, width=1.5), symbol="o", symbolSize=6, symbolBrush=FIELD,
            symbolPen=TEXT,
        )  # fmt: skip
        self._restored = self._plot.plot(
            pen=pg.mkPen(ACCENT, width=2), symbol="o", symbolSize=7, symbolBrush=ACCENT,
            symbolPen=None,
        )  # fmt: skip
        self._legend = self._plot.addLegend(
            offset=(-8, 2), labelTextColor=TEXT, labelTextSize="9pt", horSpacing=12, colCount=2
        )
        self._legend.setBrush(FIELD)
        fill_layout(QVBoxLayout(self), self._plot)

    def show_axes(
        self, nanometres: NDArray[np.float64], highest: float, *, truth: bool, error: bool
    ) -> None:
        """Set the bands, the largest share of white, and which curves the plot has."""
        self._nm = nanometres
        ticks = [(one, f"{one:g}") for one in nanometres]
        self._plot.getAxis("bottom").setTicks([ticks] if len(ticks) <= _MOST_TICKS else None)
        span = nanometres[0] - _MARGIN_NM, nanometres[-1] + _MARGIN_NM
        self._plot.setRange(xRange=span, yRange=(-_LEAST * highest, _MOST * highest), padding=0)
        self._legend.clear()
        name = "restored, 90 %" if error else "restored"
        self._legend.addItem(self._restored, name)
        if truth:
            self._legend.addItem(self._truth, "true")

    def show_spectrum(
        self, restored: Spectrum, truth: Spectrum | None, error: Spectrum | None
    ) -> None:
        """Plot a pixel's spectra, (bands,) each, in shares of white."""
        self._restored.setData(self._nm, restored)
        self._truth.setData(*(([], []) if truth is None else (self._nm, truth)))
        self._error.setVisible(error is not None)
        if error is not None:
            # A share of white isn't negative.
            for item, values in zip(self._ends, (restored - error, restored + error), strict=True):
                item.setData(self._nm, np.maximum(values, 0))

    def mark_band(self, band: int) -> None:
        self._band.setValue(float(self._nm[band]))

    @property
    def restored_spectrum(self) -> NDArray[np.float64]:
        """Return the restored spectrum that is plotted, (bands,)."""
        return np.asarray(self._restored.getData()[1])

    @property
    def true_spectrum(self) -> NDArray[np.float64]:
        """Return the true spectrum that is plotted, (bands,); empty if it isn't known."""
        values = self._truth.getData()[1]
        return np.zeros(0) if values is None else np.asarray(values)

    @property
    def interval(self) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """Return the lower and upper ends of the plotted error, (bands,) each; None without one."""
        if not self._error.isVisible():
            return None
        low, high = (np.asarray(one.getData()[1]) for one in self._ends)
        return low, high
