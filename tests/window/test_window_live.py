"""The live view shows what is there, and says what it was taken with."""

import re

import numpy as np
from PySide6.QtCore import Qt

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
