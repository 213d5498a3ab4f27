"""The tab "Accuracy": a slider from fast to exact, and what each setting costs."""

from __future__ import annotations

from PySide6.QtCore import Qt, QTimer, QUrl, Signal
from PySide6.QtGui import QDesktopServices, QShowEvent
from PySide6.QtWidgets import (
    QHBoxLayout,
    QLabel,
    QProgressBar,
    QPushButton,
    QSlider,
    QVBoxLayout,
    QWidget,
)

from labapp.window.accuracy_front import AccuracyFront
from labapp.window.accuracy_table import AccuracyTable, format_decade
from labapp.window.duration_text import format_duration
from labapp.window.messages import AccuracyForecast, AccuracyMeasured, JobProgress
from labapp.window.widgets import (
    BEGINS,
    PANEL_MARGINS,
    STOPS,
    fill_layout,
    make_label,
    plain_tip,
)

WORDS = {
    1: "rough", 2: "quick look", 3: "usual for predictions", 4: "careful", 5: "fine",
    6: "very fine", 7: "reference", 8: "exact but for rounding",
}  # fmt: skip
"""Words for each decade of the slider, by the negative power of ten."""

USUAL = 3
"""Decade of the usual tolerance of predictions, where the slider begins."""

FORECAST, MEASUREMENT = "forecast", "accuracy"
"""Names of the engine's two jobs for this tab."""

_EMPTY = "What each tolerance costs appears here when the bench is open."
_MEASURE_TIP = (
    "Measure every operation for this camera, in some minutes, and write a page. Live view rests "
    "meanwhile"
)


class AccuracyView(QWidget):
    """Let the person choose a tolerance, and show what each one costs for the present camera.

    `tolerance_requested` is emitted with a relative error, or with None for what is usual.
    `forecast_requested` and `measurement_requested` ask for the engine's two jobs, and
    `cancel_requested` names the one to cancel.
    """

    tolerance_requested = Signal(object)
    forecast_requested = Signal()
    measurement_requested = Signal()
    cancel_requested = Signal(str)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.slider = QSlider(Qt.Orientation.Horizontal, self)
        self.slider.setRange(min(WORDS), max(WORDS))
        self.slider.setPageStep(1)
        self.slider.setValue(USUAL)
        self.slider.setTickPosition(QSlider.TickPosition.TicksBelow)
        self.slider.setToolTip("Relative error of predictions and, on a virtual bench, of pictures")
        self.setting = make_label(self, rich=True)
        self.effect = make_label(self, look="faint", wrap=True)
        self.usual = QPushButton("As usual", self)
        self.usual.setToolTip("1e-3 for predictions, and the scene's own tolerance for pictures")
        self.note = make_label(self, _EMPTY, look="faint", wrap=True)
        self.table = AccuracyTable(self)
        self.front = AccuracyFront(self)
        self.predict = QPushButton("Predict again", self)
        self.measure = QPushButton("Measure everything …", self)
        self.measure.setToolTip(_MEASURE_TIP)
        self.bar = QProgressBar(self)
        self.cancel = QPushButton("Cancel", self)
        for button, kind in ((self.predict, BEGINS), (self.measure, BEGINS), (self.cancel, STOPS)):
            button.setProperty(kind, True)
        self.link = make_label(self, rich=True)
        self._scene_tolerance: float | None = None
        self._is_usual = True
        self._forecast: AccuracyForecast | None = None
        self._is_outdated = True
        self._open = False
        self._job = ""
        # The slider passes other decades on its way; the engine hears of the one it stops at.
        self._pause = QTimer(self, singleShot=True, interval=200)
        self._pause.timeout.connect(self._request_tolerance)
        self._connect()
        self._arrange()
        self._show_setting()
        self._show_job("")

    @property
    def tolerance(self) -> float | None:
        """Return the chosen relative error; None for what is usual."""
        return None if self._is_usual else self._decade

    @property
    def is_measuring(self) -> bool:
        """Return whether the full measurement is under way."""
        return self._job == MEASUREMENT

    def open_bench(self, scene_tolerance: float | None) -> None:
        """Begin as usual with a newly opened bench.

        scene_tolerance: relative error of its simulated pictures, or None.
        """
        self._open, self._scene_tolerance = True, scene_tolerance
        self._show_job("")
        self._return_to_usual()
        self.note.setText("")
        self.make_outdated()

    def close_bench(self) -> None:
        """Show that there is no engine to predict or measure anything."""
        self._open = False
        self._show_job("")
        self.note.setText("The engine is not running.")

    def make_outdated(self) -> None:
        """Predict anew: at once if the tab is visible, else when it is shown."""
        self._is_outdated = True
        if self.isVisible():
            self._request_forecast()

    def set_measuring_allowed(self, on: bool) -> None:
        """Enable the full measurement while no run or other job uses the machine."""
        self.measure.setEnabled(on and not self._job)

    def show_forecast(self, forecast: AccuracyForecast) -> None:
        self._forecast = forecast
        self.table.show_forecast(forecast)
        self.front.show_forecast(forecast)
        self.note.setText(
            f"Predicted for this camera at {1e9 * forecast.wavelength:g} nm, for the PSF that the "
            "pattern's preview shows. Processor time of one thread; click a row to choose it."
        )
        self._show_present()

    def start_measurement(self) -> None:
        """Show that the full measurement has begun."""
        self.link.setText("")
        self._show_job(MEASUREMENT, "measuring …")

    def show_progress(self, progress: JobProgress) -> None:
        """Show the progress of a job of this tab, with the time that is left."""
        if progress.job != self._job:
            return
        left = ""
        if progress.seconds_left is not None and progress.job == MEASUREMENT:
            left = f", {format_duration(progress.seconds_left)} left"
        self.bar.setValue(round(1000 * progress.fraction))
        self.bar.setFormat(f"{progress.message}{left}")

    def show_job_end(self, job: str) -> None:
        """Show that a job of this tab is over."""
        if job == self._job:
            self._show_job("")
            if self._is_outdated and self.isVisible():
                self._request_forecast()

    def show_measured(self, report: AccuracyMeasured) -> None:
        """Show a link to the page of measured costs."""
        counts = f"{report.measured} of {report.operations} operations"
        done = f" (cancelled after {counts})" if report.cancelled else ""
        url = QUrl.fromLocalFile(str(report.page.absolute())).toString()
        self.link.setText(f'<a href="{url}">Open the page</a>{done}')
        self.link.setToolTip(plain_tip(str(report.page)))

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        if self._is_outdated:
            self._request_forecast()

    @property
    def _decade(self) -> float:
        return float(f"1e-{self.slider.value()}")

    def _connect(self) -> None:
        self.slider.valueChanged.connect(self._move)
        self.usual.clicked.connect(self._choose_usual)
        self.predict.clicked.connect(self._request_forecast)
        self.measure.clicked.connect(self.measurement_requested)
        self.cancel.clicked.connect(lambda: self.cancel_requested.emit(self._job))
        self.table.clicked.connect(lambda index: self.slider.setValue(index.row() + min(WORDS)))
        self.link.linkActivated.connect(lambda link: QDesktopServices.openUrl(QUrl(link)))

    def _arrange(self) -> None:
        # The longest words fit, and texts of one or two lines take the same room.
        self.setting.setMinimumWidth(210)
        self.effect.setMinimumHeight(2 * self.fontMetrics().lineSpacing())
        self.effect.setAlignment(Qt.AlignmentFlag.AlignTop)
        slider = fill_layout(
            QHBoxLayout(), QLabel("Fast", self), (self.slider, 1), QLabel("Exact", self),
            self.setting, self.usual, spacing=8,
        )  # fmt: skip
        jobs = fill_layout(
            QHBoxLayout(), self.predict, self.measure, (self.bar, 1), self.cancel, self.link,
            spacing=6,
        )  # fmt: skip
        parts = slider, self.effect, self.table, (self.front, 1), self.note, jobs
        fill_layout(QVBoxLayout(self), *parts, margins=PANEL_MARGINS, spacing=6)

    def _move(self, _: int) -> None:
        self._is_usual = False
        self._show_setting()
        self._pause.start()

    def _choose_usual(self) -> None:
        self._return_to_usual()
        self._request_tolerance()

    def _return_to_usual(self) -> None:
        self._pause.stop()
        self.slider.blockSignals(True)
        self.slider.setValue(USUAL)
        self.slider.blockSignals(False)
        self._is_usual = True
        self._show_setting()

    def _request_tolerance(self) -> None:
        self.tolerance_requested.emit(self.tolerance)

    def _request_forecast(self) -> None:
        if not self._open or self._job:
            return
        self._is_outdated = False
        self._show_job(FORECAST, "predicting …")
        self.forecast_requested.emit()

    def _show_setting(self) -> None:
        self.setting.setText(f"<b>{format_decade(self._decade)}</b> · {WORDS[self.slider.value()]}")
        self.usual.setEnabled(not self._is_usual)
        self.effect.setText(self._effect_text())
        self._show_present()

    def _effect_text(self) -> str:
        """Say what the slider acts on now."""
        predictions = f"Predicted PSFs are within {format_decade(self._decade)} of the exact ones."
        scene = self._scene_tolerance
        if scene is None:
            return f"{predictions} The camera's pictures are real: the slider doesn't change them."
        if self._is_usual:
            return f"{predictions} Live pictures keep the scene's own tolerance, {scene:g}."
        return (
            f"{predictions} Live pictures, too, except for effects that the scene forces. Runs "
            f"keep the scene's tolerance, {scene:g}."
        )

    def _show_present(self) -> None:
        if self._forecast is None:
            return
        self.table.selectRow(self.slider.value() - min(WORDS))
        tol = next((t for t in self._forecast.tolerances if abs(t / self._decade - 1) < 1e-6), 0.0)
        self.front.show_present(self._forecast.chosen_point(tol))

    def _show_job(self, job: str, text: str = "") -> None:
        self._job = job
        self.bar.setVisible(bool(job))
        self.cancel.setVisible(bool(job))
        self.bar.setRange(0, 1000)
        self.bar.setValue(0)
        self.bar.setFormat(text)
        self.predict.setEnabled(self._open and not job)
        self.measure.setEnabled(self._open and not job)
