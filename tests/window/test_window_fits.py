"""Nothing is cut or out of reach in a small window, whatever it has to say."""

import pytest
from figures.window_geometry import all_faults, faults
from PySide6.QtCore import QRect
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QLabel
from waits import wait_until

from labapp.runs.state import State
from labapp.window.elided_label import ElidedLabel, shorten
from labapp.window.engine_connection import EngineConnection
from labapp.window.main_window import MainWindow
from labapp.window.messages import BenchOpened, BenchState, DeviceInfo, Prompt, QueueState, RunInfo
from labapp.window.remembered_settings import RememberedSettings

ERROR = (
    "The filter (VariSpec VIS-10, port /dev/serial/by-id/usb-FTDI_FT232R_USB_UART_A5069RR4) gave "
    "no reply to 'W 550.00' in 2 s. Check that it is switched on, and its cable, then press "
    "Reconnect."
)


def settle():
    QTest.qWait(60)


@pytest.fixture
def small(dark_theme, qtbot, tmp_path):
    """A window of 1280 × 720 with a bench of long names, and no engine."""
    window = MainWindow(EngineConnection(), RememberedSettings(tmp_path / "window.ini"))
    qtbot.addWidget(window)
    window.show()
    window.setGeometry(QRect(0, 0, 1280, 720))
    models = {
        "slm": "HOLOEYE PLUTO-2.1 VIS-016 on DP-2",
        "filter": "CRI VariSpec VIS-10-20-STD",
        "camera": "FLIR Oryx ORX-10G-51S5M",
        "targets": "placed by a person",
    }
    devices = tuple(DeviceInfo(name, model, name == "slm") for name, model in models.items())
    targets = ("photograph", "a print of the Siemens star at 1.5 m")
    opened = BenchOpened(
        "Bench", devices, targets, (4e-7, 7e-7), (1e-5, 1000.0), (2048, 2448), 4095, False
    )
    report = window.connection.report_received.emit
    report(opened)
    report(BenchState(devices, targets[1], "ring of 80 µm", 5.5e-7, 0.4, True))
    settle()
    return window, report


def test_everything_can_be_read_and_reached(small):
    window, _ = small
    assert window.size().toTuple() == (1280, 720)
    assert all_faults(window, window.geometry(), settle) == {}


def test_what_a_person_needs_at_once_is_seen_without_scrolling(small):
    window, _ = small
    room = window.settings
    for seen in (
        window.bar.badge, window.pattern.show_button, window.pattern.displayed_label,
        room.target_read, room.wavelength_read, room.exposure_read, window.message,
        window.run.bar,
    ):  # fmt: skip
        whole = seen.rect()
        assert seen.visibleRegion().boundingRect() == whole, seen


def test_trouble_fits_as_well(small):
    window, report = small
    failed = DeviceInfo("filter", "CRI VariSpec", False, "failed", "550.00 nm", ERROR)
    report(BenchState((failed,), "photograph", "ring", 5.5e-7, 0.4, False))
    run = RunInfo(
        7, "A night of exposures", window.run.chosen_folder / "night.h5", State.PAUSED, ERROR,
        3, 240, 0.3, 600.0, 0.0, 12.0, 900.0, False,
    )  # fmt: skip
    prompt = Prompt(3, "Place the print of the Siemens star at 1.5 m, square to the optical axis.")
    report(QueueState((run,), "A run before was cancelled", prompt))
    window.message.show_error(ERROR, restart=True)
    window.message.show_message("The bracket is put in line …")
    settle()
    assert faults(window, window.geometry()) == []
    assert window.message.accept.isVisible()
    report(QueueState(()))


def test_a_closed_dock_comes_back_from_the_menu(small):
    window, _ = small
    dock = window.docks["Pattern"]
    dock.close()
    panels = window.bar.menus.menus["Panels"]
    toggle = next(one for one in panels.actions() if one.text() == "Pattern")
    assert not toggle.isChecked()
    toggle.trigger()
    wait_until(dock.isVisible)
    window.docks["Log"].close()
    window.message.log_requested.emit()
    wait_until(lambda: not window.log.visibleRegion().isEmpty())


def test_an_elided_label_says_the_rest_in_its_tip(dark_theme, qtbot):
    label = ElidedLabel(lines=2)
    qtbot.addWidget(label)
    label.setFixedSize(220, 60)
    label.show()
    label.setText("short")
    assert (label.text(), label.is_elided, label.toolTip()) == ("short", False, "")
    long = "word " * 60 + "end"
    label.setText(long)
    assert label.text() == long
    assert label.is_elided
    assert label.toolTip() == long
    shown = QLabel.text(label)
    assert shown.endswith("…")
    assert shown.count("\n") == 1
    label.setFixedSize(3000, 60)
    wait_until(lambda: not label.is_elided)
    assert label.toolTip() == ""


def test_shortened_lines_are_no_wider_than_their_room(dark_theme, qtbot):
    label = QLabel()
    qtbot.addWidget(label)
    text = "one two three four five six seven eight nine ten eleven twelve"
    for width in (40, 90, 200, 1000):
        for lines in (1, 2, 3):
            shown = shorten(text, label.font(), width, lines).split("\n")
            assert len(shown) <= lines
            assert all(label.fontMetrics().horizontalAdvance(one) <= width for one in shown)
            assert text.startswith(" ".join(shown).rstrip("…").strip())
