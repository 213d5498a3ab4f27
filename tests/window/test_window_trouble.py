"""What goes wrong is said, and the window lives on."""

import os
import signal
import subprocess
import sys
from pathlib import Path

from labapp.window.connection import Connection
from labapp.window.main_window import MainWindow
from labapp.window.remembered import Remembered


def alive(process_id):
    status = Path(f"/proc/{process_id}/stat")
    return status.exists() and status.read_text().rpartition(")")[2].split()[0] != "Z"


def test_a_killed_engine_is_noticed_and_restarted(bench, person):
    window = bench.window
    os.kill(bench.connection.process_id, signal.SIGKILL)
    person.waits(lambda: window.message.is_error)
    assert "engine was killed or crashed" in window.message.text
    assert window.bar.badge.text() == "BENCH NOT OPEN"
    assert not window.actions_["acquire"].isEnabled()
    assert "STOPPED" in window.live_view.caption.text()
    assert "unknown" in window.pattern.shown.text()
    count = bench.frames
    person.clicks(window.message.restart)
    person.waits(lambda: bench.frames > count)
    assert window.bar.badge.text().startswith("SIMULATED")
    assert not window.message.is_error
    assert not window.message.restart.isVisible()


def test_an_engine_that_hangs_does_not_hang_the_window(bench, person, qtbot):
    os.kill(bench.connection.process_id, signal.SIGSTOP)
    try:
        qtbot.wait(200)
        count = bench.frames
        person.types(bench.window.settings.exposure, "50")
        for _ in range(20):
            person.clicks(bench.window.pattern.show_button)
        assert bench.frames == count
        assert "400.000 ms" in bench.window.live_view.caption.text()
        assert bench.window.settings.exposure_read.property("differs") is not None
    finally:
        os.kill(bench.connection.process_id, signal.SIGCONT)
    person.waits(lambda: bench.frame.exposure == 0.05)


def test_an_error_stays_until_it_is_clicked(bench, person):
    message = bench.window.message
    message.say("all is well")
    message.complain("The filter wheel is silent. Check its cable.")
    message.say("more news")
    assert message.text == "The filter wheel is silent. Check its cable."
    person.clicks(message)
    assert message.text == "more news"


def test_closing_the_window_ends_the_engine(dark_theme, qtbot, tmp_path):
    connection = Connection()
    window = MainWindow(connection, Remembered(tmp_path / "window.ini"))
    qtbot.addWidget(window)
    window.show()
    connection.start()
    qtbot.waitUntil(lambda: window.actions_["live"].isEnabled(), timeout=60_000)
    engine = connection.process_id
    assert alive(engine)
    window.close()
    assert not alive(engine)


def test_a_killed_window_leaves_no_engine(display, tmp_path, qtbot):
    child = subprocess.Popen(
        [sys.executable, "-c", "from labapp.window.app import main; main()"],
        env={**os.environ, "HOME": str(tmp_path), "XDG_CONFIG_HOME": str(tmp_path)},
    )
    children = Path(f"/proc/{child.pid}/task/{child.pid}/children")
    qtbot.waitUntil(lambda: children.read_text() != "", timeout=60_000)
    engine = int(children.read_text().split()[0])
    child.kill()
    child.wait()
    qtbot.waitUntil(lambda: not alive(engine), timeout=60_000)


def test_a_bench_that_does_not_open_says_why(dark_theme, qtbot, tmp_path):
    bad = tmp_path / "bench.toml"
    bad.write_text("version = 1\nname = 3\n")
    connection = Connection(bench=bad)
    window = MainWindow(connection, Remembered(tmp_path / "window.ini"))
    qtbot.addWidget(window)
    window.show()
    connection.start()
    qtbot.waitUntil(lambda: window.message.is_error, timeout=60_000)
    assert "The bench didn't open" in window.message.text
    assert str(bad) in window.message.text
    assert window.message.restart.isVisible()
    window.close()
