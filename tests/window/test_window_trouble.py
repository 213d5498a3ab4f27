"""What goes wrong is said, and the window lives on."""

import os
import signal
import subprocess
import sys
from pathlib import Path

from waits import wait_until
from window_bench import alive, state_of

from labapp.window.commands import SetExposure


def test_a_killed_engine_is_noticed_and_restarted(bench, person):
    window = bench.window
    person.clicks(window.bar.buttons["why"])
    effects = window.effects.table.effects
    person.waits(lambda: effects.rowCount() > 0)
    os.kill(bench.connection.process_id, signal.SIGKILL)
    person.waits(lambda: window.message.is_error)
    assert "engine was killed or crashed" in window.message.text
    assert window.bar.badge.text() == "BENCH NOT OPEN"
    assert not window.actions_["acquire"].isEnabled()
    assert "STOPPED" in window.live_view.caption.text()
    assert "unknown" in window.pattern.displayed_label.text()
    assert effects.rowCount() == 0
    assert window.effects.summary.text() == "The engine is not running."
    count = bench.frames
    person.clicks(window.message.restart)
    person.waits(lambda: bench.frames > count)
    assert window.bar.badge.text().startswith("SIMULATED")
    assert not window.message.is_error
    assert not window.message.restart.isVisible()
    person.waits(lambda: effects.rowCount() > 0)


def test_an_engine_that_hangs_does_not_hang_the_window(bench, person, qtbot):
    engine = bench.connection.process_id
    os.kill(engine, signal.SIGSTOP)
    try:
        person.waits(lambda: state_of(engine) == "T")
        # What it had sent is taken in.
        qtbot.wait(200)
        count = bench.frames
        person.types(bench.window.settings.exposure, "50")
        for _ in range(20):
            person.clicks(bench.window.pattern.show_button)
        # More than the way to it holds.
        for _ in range(2000):
            bench.connection.send(SetExposure(0.05))
        assert bench.frames == count
        assert "400.000 ms" in bench.window.live_view.caption.text()
        assert bench.window.settings.exposure_read.property("differs") is not None
    finally:
        os.kill(engine, signal.SIGCONT)
    person.waits(lambda: bench.frame.exposure == 0.05)


def test_an_error_stays_until_it_is_clicked(bench, person):
    message = bench.window.message
    message.show_message("all is well")
    message.show_error("The filter wheel is silent. Check its cable.")
    message.show_message("more news")
    # The error stays, and hides nothing.
    assert message.text == "The filter wheel is silent. Check its cable."
    assert message.message == "more news"
    person.clicks(message.accept)
    assert message.text == "more news"
    assert not message.accept.isVisible()
    # The log keeps all of them in their order, and tells an error by its sign.
    last = [line.split(maxsplit=1)[1] for line in bench.window.log.lines[-3:]]
    assert last == [
        "· all is well",
        "✖ The filter wheel is silent. Check its cable.",
        "· more news",
    ]
    bench.window.log.errors_only.setChecked(True)
    assert all("✖" in line for line in bench.window.log.lines)
    bench.window.log.errors_only.setChecked(False)
    assert bench.window.log.lines[-1].endswith("more news")


def test_closing_the_window_ends_the_engine(own_bench):
    bench = own_bench()
    engine = bench.connection.process_id
    assert alive(engine)
    bench.window.close()
    assert not alive(engine)


def test_a_killed_window_leaves_no_engine(display, tmp_path):
    child = subprocess.Popen(
        [sys.executable, "-c", "from labapp.window.app import main; main()"],
        env={**os.environ, "HOME": str(tmp_path), "XDG_CONFIG_HOME": str(tmp_path)},
    )
    children = Path(f"/proc/{child.pid}/task/{child.pid}/children")
    try:
        wait_until(lambda: children.read_text() != "")
        engine = int(children.read_text().split()[0])
    finally:
        child.kill()
        child.wait()
    wait_until(lambda: not alive(engine))


def test_a_bench_that_does_not_open_says_why(new_bench, tmp_path):
    bad = tmp_path / "bench.toml"
    bad.write_text("version = 1\nname = 3\n")
    bench = new_bench(bench=bad)
    message = bench.window.message
    wait_until(lambda: message.is_error, bench.describe)
    assert "The bench didn't open" in message.text
    assert str(bad) in message.text
    assert message.restart.isVisible()
