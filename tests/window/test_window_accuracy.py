"""The tab that says what accuracy costs, and the slider that chooses it."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest
from PySide6.QtCore import Qt
from waits import wait_until

from labapp.accuracy.overview.operations import OPERATIONS
from labapp.window.accuracy_view import FORECAST, MEASUREMENT, USUAL, WORDS, AccuracyView
from labapp.window.engine.live_tolerance import LiveTolerance
from labapp.window.messages import (
    AccuracyForecast,
    AccuracyMeasured,
    AccuracyPoint,
    EffectsReport,
    JobProgress,
    LivePrediction,
    PatternPreview,
)

TOLERANCES = tuple(10.0**-k for k in range(1, 9))


def point(tol: float, method: str = "gridded FFT", **changes) -> AccuracyPoint:
    told = {
        "method": method, "tol": tol, "error": tol / 20, "first_seconds": 0.08 - tol / 10,
        "each_seconds": 0.02 - tol / 10, "memory": 12_300_000, "chosen": True, "on_front": True,
        "failure": "",
    }  # fmt: skip
    return AccuracyPoint(**(told | changes))


REFUSED = point(
    1e-8, error=None, first_seconds=None, each_seconds=None, memory=None, chosen=False,
    on_front=False, failure="tol 1e-08 can't be kept",
)  # fmt: skip
FORECAST_REPORT = AccuracyForecast(
    612e-9,
    TOLERANCES,
    (*(point(tol) for tol in TOLERANCES[:-1]), REFUSED),
    tuple(LivePrediction(tol, tol / 2, 1.0) for tol in TOLERANCES),
)


@pytest.fixture
def view(qtbot, dark_theme):
    made = AccuracyView()
    qtbot.addWidget(made)
    made.asked = []
    made.tolerance_requested.connect(lambda tol: made.asked.append(tol))
    made.forecasts = []
    made.forecast_requested.connect(lambda: made.forecasts.append(1))
    made.resize(690, 560)
    made.show()
    wait_until(lambda: made.windowHandle().isExposed())
    return made


def cells(view: AccuracyView, row: int) -> list[str]:
    model = view.table.tolerances
    return [model.index(row, column).data() for column in range(model.columnCount())]


def test_the_slider_says_number_and_word_of_every_decade(view, qtbot):
    view.open_bench(0.01)
    for decade, words in WORDS.items():
        view.slider.setValue(decade)
        assert view.setting.text() == f"<b>1e-{decade}</b> · {words}"
        assert f"within 1e-{decade} of" in view.effect.text()
    # Only the decade where it stops is asked for.
    wait_until(lambda: view.asked == [1e-8])
    qtbot.mouseClick(view.usual, Qt.MouseButton.LeftButton)
    assert view.asked == [1e-8, None]
    assert view.slider.value() == USUAL
    assert "scene's own tolerance, 0.01" in view.effect.text()


def test_real_pictures_are_not_claimed_to_change(view):
    view.open_bench(None)
    view.slider.setValue(2)
    assert "real: the slider doesn't change them" in view.effect.text()


def test_each_tolerance_is_a_row_and_the_present_one_is_marked(view, qtbot):
    view.open_bench(0.01)
    view.show_forecast(FORECAST_REPORT)
    assert cells(view, 1) == [
        "1e-2", "5e-4", "79 ms", "19 ms", "12.3 MB", "5e-3", "1 s", "gridded FFT",
    ]  # fmt: skip
    assert cells(view, 7)[:5] == ["1e-8", "–", "–", "–", "–"]
    assert cells(view, 7)[-1] == "can't be kept"
    hint = view.table.tolerances.index(7, 0).data(Qt.ItemDataRole.ToolTipRole)
    assert hint == "tol 1e-08 can't be kept"
    assert "612 nm" in view.note.text()
    for row in (0, 4):
        place = view.table.visualRect(view.table.tolerances.index(row, 2)).center()
        qtbot.mouseClick(view.table.viewport(), Qt.MouseButton.LeftButton, pos=place)
        assert view.slider.value() == row + 1
        seconds, error = view.front.present_place
        assert 10**error == pytest.approx(10.0 ** -(row + 1) / 20)
        assert 10**seconds == pytest.approx(0.02 - 10.0 ** -(row + 2))
    view.slider.setValue(8)
    assert view.front.present_place is None


def test_all_columns_fit_a_small_screen(view):
    view.open_bench(0.01)
    view.show_forecast(FORECAST_REPORT)
    view.resize(620, 560)
    header = view.table.horizontalHeader()
    last = view.table.tolerances.columnCount() - 1
    wait_until(lambda: view.table.width() < 620)
    letters = view.table.fontMetrics()
    assert header.sectionSize(last) >= letters.horizontalAdvance("gridded FFT")
    assert header.length() <= view.table.viewport().width()


def test_jobs_are_shown_and_can_be_cancelled(view, qtbot):
    cancelled = []
    view.cancel_requested.connect(cancelled.append)
    view.open_bench(0.01)
    assert view.forecasts == [1]
    assert view.bar.isVisible()
    view.show_progress(JobProgress(FORECAST, 0.5, "tolerance 1e-04", 3.0))
    assert (view.bar.value(), view.bar.text()) == (500, "tolerance 1e-04")
    assert not view.measure.isEnabled()
    qtbot.mouseClick(view.cancel, Qt.MouseButton.LeftButton)
    assert cancelled == [FORECAST]
    view.show_job_end(FORECAST)
    assert not view.bar.isVisible()
    view.start_measurement()
    view.show_progress(JobProgress(MEASUREMENT, 0.1, "PSF of a lens: timing", 120.0))
    assert view.bar.text() == "PSF of a lens: timing, 2 min left"
    view.make_outdated()
    assert view.forecasts == [1]
    view.show_job_end(MEASUREMENT)
    # What became old meanwhile is predicted now.
    assert view.forecasts == [1, 1]


def test_the_page_is_linked(view, tmp_path, monkeypatch):
    opened = []
    monkeypatch.setattr("PySide6.QtGui.QDesktopServices.openUrl", opened.append)
    page = tmp_path / "accuracy.html"
    view.show_measured(AccuracyMeasured(page, 2, 7, cancelled=True))
    assert "cancelled after 2 of 7 operations" in view.link.text()
    view.show_measured(AccuracyMeasured(page, 6, 7, cancelled=False))
    assert "cancelled" not in view.link.text()
    view.link.linkActivated.emit(page.as_uri())
    assert [Path(url.toLocalFile()) for url in opened] == [page]


def test_without_an_engine_nothing_is_asked_for(view):
    view.open_bench(0.01)
    view.close_bench()
    assert view.note.text() == "The engine is not running."
    for part in (view.measure, view.predict):
        assert not part.isEnabled()
    assert not view.bar.isVisible()
    before = list(view.forecasts)
    view.make_outdated()
    assert view.forecasts == before


def test_only_live_frames_have_the_windows_tolerance_and_are_decided_by_estimates():
    imaging = SimpleNamespace(tol=0.01, decide_by="bound")
    live = LiveTolerance(SimpleNamespace(imaging=imaging))
    live.set(1e-4)
    assert live.is_frame_given_up
    with live.during_frame():
        assert (imaging.tol, imaging.decide_by) == (1e-4, "estimate")
        assert not live.is_frame_given_up
    assert (imaging.tol, imaging.decide_by) == (0.01, "bound")
    live.set(None)
    with live.during_frame():
        assert (imaging.tol, imaging.decide_by) == (0.01, "estimate")


def test_a_frame_that_fails_leaves_the_scenes_tolerance():
    imaging = SimpleNamespace(tol=0.01, decide_by="bound")
    live = LiveTolerance(SimpleNamespace(imaging=imaging))
    live.set(1e-4)
    with pytest.raises(RuntimeError), live.during_frame():
        raise RuntimeError
    assert (imaging.tol, imaging.decide_by) == (0.01, "bound")


@pytest.mark.parametrize("tol", [0.0, -1.0, float("inf"), float("nan")])
def test_a_tolerance_that_is_none_is_refused(tol):
    with pytest.raises(ValueError, match="give a positive number"):
        LiveTolerance(None).set(tol)


def test_a_real_camera_keeps_out_of_it():
    live = LiveTolerance(None)
    live.set(1e-4)
    assert not live.is_frame_given_up


def test_the_slider_reaches_predictions_and_live_pictures(bench, person):
    window, view = bench.window, bench.window.accuracy
    window.pattern.schedule_preview()  # The window's first may have come before the test began.
    person.waits(lambda: bench.last(PatternPreview) is not None)
    window.tabs.setCurrentWidget(view)
    try:
        for tol in (1e-1, 1e-4):
            bench.reports.clear()
            view.slider.setValue({1e-1: 1, 1e-4: 4}[tol])
            person.waits(lambda t=tol: getattr(bench.last(EffectsReport), "tol", 0) == t)
            person.waits(lambda: bench.last(PatternPreview) is not None)
        frames = bench.frames
        person.waits(lambda: bench.frames > frames + 1)
        assert window.actions_["live"].isChecked()
    finally:
        bench.reports.clear()
        person.clicks(view.usual)
    person.waits(lambda: getattr(bench.last(EffectsReport), "tol", 0) == 0.01)


def test_the_engine_predicts_what_each_tolerance_costs(bench, person):
    view = bench.window.accuracy
    bench.window.tabs.setCurrentWidget(view)
    view.make_outdated()
    person.waits(lambda: bench.last(AccuracyForecast) is not None)
    told = bench.last(AccuracyForecast)
    chosen = [told.chosen_point(tol) for tol in told.tolerances]
    assert len(told.live) == 8
    assert all(
        p is None or (p.error <= p.tol and p.first_seconds >= p.each_seconds) for p in chosen
    )
    assert sum(p is not None for p in chosen) >= 6
    assert all(one.error is None or one.seconds > 0 for one in told.live)
    person.waits(lambda: view.table.tolerances.rowCount() == 8 and view.predict.isEnabled())


def test_a_measurement_that_is_cancelled_at_once_leaves_nothing(bench, person):
    view, folder = bench.window.accuracy, Path(bench.window.run.folder.text())
    bench.window.tabs.setCurrentWidget(view)
    person.waits(view.measure.isEnabled)
    before = set(folder.glob("accuracy_*"))
    person.clicks(view.measure)
    person.clicks(view.cancel)
    person.waits(view.measure.isEnabled, patience=60)
    person.waits(bench.window.actions_["live"].isChecked)
    assert bench.last(AccuracyMeasured) is None
    assert set(folder.glob("accuracy_*")) == before


@pytest.mark.sweep
@pytest.mark.timeout(600)
def test_a_measurement_writes_its_page(bench, person):
    view = bench.window.accuracy
    bench.window.tabs.setCurrentWidget(view)
    person.waits(view.measure.isEnabled)
    person.clicks(view.measure)
    person.waits(lambda: bench.last(AccuracyMeasured) is not None, patience=450)
    told = bench.last(AccuracyMeasured)
    assert told.page.exists()
    # A camera's panel stands in the plane of the lens or apart from it: one of the two is left out.
    assert (told.measured, told.cancelled) == (len(OPERATIONS) - 1, False)
    assert "Open the page" in view.link.text()
