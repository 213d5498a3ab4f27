"""The live view shows what is there, and says what it was taken with."""

import os
import re
import signal

import numpy as np
import pytest
from PySide6.QtCore import QEvent, QPoint, QPointF, Qt
from PySide6.QtGui import QMouseEvent
from PySide6.QtWidgets import QApplication

from labapp.window.histogram_view import HistogramView
from labapp.window.messages import LivePicture


def test_pictures_follow_each_other(bench, person):
    view = bench.window.live_view.picture
    before, count = person.looks_at(view), bench.frames
    person.waits(lambda: bench.frames > count + 5)
    # The scene stands still; its noise doesn't.
    person.waits(lambda: bool((person.looks_at(view) != before).any()))


def test_f5_stops_and_starts(bench, person):
    person.presses(Qt.Key.Key_F5)
    person.waits(lambda: "STOPPED" in bench.window.live_view.caption.text())
    count = bench.frames
    assert "stopped" in bench.window.devices.text("camera")
    person.presses(Qt.Key.Key_F5)
    person.waits(lambda: bench.frames > count)
    person.waits(lambda: "STOPPED" not in bench.window.live_view.caption.text())


def test_another_target_is_another_picture(bench, person):
    before = person.looks_at(bench.window.live_view.picture).astype(int)
    person.chooses(bench.window.settings.target, "dark")
    person.waits(lambda: bench.frame.target == "dark")
    person.waits(lambda: bench.window.settings.target_read.text() == "dark")
    view = bench.window.live_view.picture
    person.waits(lambda: np.abs(person.looks_at(view) - before).mean() > 20)


def test_wavelength_and_exposure_are_read_back(bench, person):
    settings = bench.window.settings
    person.types(settings.wavelength, "612.34")
    person.types(settings.exposure, "123.457")
    person.waits(lambda: settings.wavelength_read.text() == "612.34 nm")
    person.waits(lambda: settings.exposure_read.text() == "123.457 ms")
    person.waits(lambda: bench.frame.exposure == 0.123457)
    assert round(bench.frame.wavelength * 1e9, 2) == 612.34


def test_the_caption_is_of_the_frame_that_is_shown(bench, person):
    """Turn the exposure while pictures come: brightness and caption never disagree."""
    said = {}
    view = bench.window.live_view

    def compare(report):
        if isinstance(report, LivePicture):
            report = report.frame
            exposure = float(re.search(r"([\d.]+) ms", view.caption.text())[1])
            said.setdefault(exposure, set()).add(round(float(report.image.mean()) - 64, -1))
            assert exposure == round(report.exposure * 1e3, 3)

    bench.connection.report_received.connect(compare)
    for exposure in ("800", "50", "400"):
        person.types(bench.window.settings.exposure, exposure)
        person.waits(lambda ms=float(exposure): bench.frame.exposure == ms * 1e-3)
        count = bench.frames
        person.waits(lambda n=count: bench.frames > n + 2)
    bench.connection.report_received.disconnect(compare)
    assert set(said) == {800.0, 50.0, 400.0}
    assert max(said[50.0]) < min(said[400.0])
    assert max(said[400.0]) < min(said[800.0])


def test_the_cursor_reads_digital_numbers(bench, person):
    view = bench.window.live_view
    person.moves_mouse(view.picture, view.picture.pixel_position(20, 30).toPoint())
    person.waits(lambda: view.cursor_reading.text().startswith("x 30  y 20"))
    reading = re.search(r"(\d+) DN   ([\d.]+) %", view.cursor_reading.text())
    assert 64 <= int(reading[1]) <= 4095
    assert abs(float(reading[2]) - 100 * int(reading[1]) / 4095) < 0.06


def test_a_key_holds_the_contrast(bench, person):
    action = bench.window.actions_["contrast"]
    person.presses(Qt.Key.Key_A)
    assert not action.isChecked()
    levels = bench.window.live_view.levels
    person.types(bench.window.settings.exposure, "50")
    person.waits(lambda: bench.frame.exposure == 0.05)
    assert bench.window.live_view.levels == levels
    person.presses(Qt.Key.Key_A)
    assert action.isChecked()
    person.waits(lambda: bench.window.live_view.levels != levels)


def test_a_handle_of_the_histogram_is_dragged_while_pictures_come(bench, person, qtbot):
    """Frames that come meanwhile don't take it out of the hand."""
    view, action = bench.window.live_view, bench.window.actions_["contrast"]
    person.waits(lambda: bench.frame.exposure == 0.4)

    def is_drawn():
        """The histogram is drawn less often than pictures: it may still be of another exposure."""
        return np.allclose(view.histogram._levels.getRegion(), view.levels, rtol=0, atol=10)

    person.waits(is_drawn)
    low, high = view.levels
    place = view.histogram.handle_position(1)
    plot = view.histogram.plot.viewport()
    qtbot.mousePress(plot, Qt.MouseButton.LeftButton, pos=place)
    for step in range(1, 11):
        count = bench.frames
        send_drag(plot, place + QPoint(6 * step, 0))
        person.waits(lambda n=count: bench.frames > n + 1)
    qtbot.mouseRelease(plot, Qt.MouseButton.LeftButton, pos=place + QPoint(60, 0))
    assert not action.isChecked()
    assert abs(view.levels[0] - low) < 64
    assert view.levels[1] > high + 100
    held = view.levels
    count = bench.frames
    person.waits(lambda: bench.frames > count + 10)
    assert view.levels == held
    # The engine draws with them: a higher white makes a darker picture.
    assert (bench.shown.indices < 200).mean() > 0.9
    person.presses(Qt.Key.Key_A)
    person.waits(lambda: view.levels[1] < held[1] - 50)


def test_a_handle_stays_under_the_mouse_that_is_pressed_on_it(dark_theme, qtbot):
    """Otherwise, a picture that comes before the drag begins takes both handles along."""
    histogram, dragged = HistogramView(), []
    qtbot.addWidget(histogram)
    histogram.resize(800, 100)
    with qtbot.waitExposed(histogram):
        histogram.show()
    histogram.show_counts(np.ones(4096, np.float32), 1.0)
    histogram.show_levels(1000.0, 2000.0)
    histogram.levels_dragged.connect(lambda low, high: dragged.append((low, high)))
    place, plot = histogram.handle_position(1), histogram.plot.viewport()
    qtbot.mousePress(plot, Qt.MouseButton.LeftButton, pos=place)
    histogram.show_levels(1200.0, 2400.0)
    for step in (20, 40):
        qtbot.wait(20)  # Moves that come in a rush are left out.
        send_drag(plot, place + QPoint(step, 0))
    qtbot.mouseRelease(plot, Qt.MouseButton.LeftButton, pos=place + QPoint(40, 0))
    assert {low for low, _ in dragged} == {1000.0}
    assert dragged[-1][1] == pytest.approx(2000.0 + 40 * 4096 / 760, abs=25)
    histogram.show_levels(500.0, 600.0)
    assert histogram.handle_position(1).x() < place.x()


def send_drag(widget, place):
    """Move the mouse with its left button held down."""
    where = QPointF(place)
    event = QMouseEvent(
        QEvent.Type.MouseMove, where, QPointF(widget.mapToGlobal(place)),
        Qt.MouseButton.NoButton, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier,
    )  # fmt: skip
    QApplication.sendEvent(widget, event)


def test_frames_come_as_often_as_the_screen_is_redrawn(bench, person):
    view = bench.window.live_view
    person.waits(lambda: "frames/s" in view.rate_caption.text())
    person.waits(lambda: bench.picture.dropped == bench.picture.missed == 0)
    assert "dropped 0  ·  missed 0" in view.rate_caption.text()


def test_the_rate_ages_when_no_frame_comes(bench, person):
    view = bench.window.live_view
    person.waits(lambda: "frames/s" in view.rate_caption.text())
    engine = bench.connection.process_id
    os.kill(engine, signal.SIGSTOP)
    try:
        person.waits(lambda: "no frame for 2 s" in view.rate_caption.text())
    finally:
        os.kill(engine, signal.SIGCONT)
    person.waits(lambda: "frames/s" in view.rate_caption.text())


def test_a_zoomed_view_gets_its_own_part_of_the_frame(bench, person):
    view = bench.window.live_view
    view.picture.box.setRange(xRange=(10, 30), yRange=(5, 20), padding=0)
    try:
        person.waits(lambda: bench.shown.region[2] < 64)
        row, column, rows, columns = bench.shown.region
        assert column <= 10
        assert column + columns >= 30
        assert row <= 5
        assert row + rows >= 20
        assert bench.shown.indices.shape == (rows, columns)
    finally:
        view.picture.fit()
    person.waits(lambda: bench.shown.region == (0, 0, 64, 96))


def test_a_stopped_picture_can_still_be_zoomed_and_toned(bench, person):
    view = bench.window.live_view
    person.presses(Qt.Key.Key_F5)
    person.waits(lambda: "STOPPED" in view.caption.text())
    try:
        before = person.looks_at(view.picture).astype(int)
        view.set_levels(0.0, 100.0)
        person.waits(lambda: person.looks_at(view.picture).mean() > before.mean() + 20)
        person.presses(Qt.Key.Key_A)
    finally:
        person.presses(Qt.Key.Key_F5)
    person.waits(lambda: "STOPPED" not in view.caption.text())
