"""Devices that fail: shown, opened again, waited for; and a bench that is left safe."""

import pytest
from person import Person
from plan_files import write_plan
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QMessageBox
from window_bench import alive
from window_scene import write_bench

from labapp.runs.record.reader import Record
from labapp.runs.state import State
from labapp.window.messages import BenchState
from simulator.machines.varispec import VariSpecMachine
from simulator.wire import SimulatedLine, WireFault
from simulator.wire.pty import PtyLine


def hangs(device, frame=0, times=1):
    """A fault file's table."""
    return f'[[fault]]\ndevice = "{device}"\nkind = "hung"\nframe = {frame}\ntimes = {times}\n'


def test_a_dead_device_is_shown_and_opened_again(own_bench, qtbot):
    """The filter hangs when it is first set, and is killed."""
    bench = own_bench(hangs("filter"))
    window, person = bench.window, Person(bench, qtbot)
    person.waits(lambda: window.message.is_error)
    person.waits(lambda: "failed" in window.devices.text("filter"))
    # With its model and its last value, though it answers no question any more.
    assert "simulated tunable filter" in window.devices.text("filter")
    assert "550.00 nm ?" in window.devices.text("filter")
    assert "hung at" in window.devices.text("filter")
    for name in ("slm", "camera", "targets"):
        assert "failed" not in window.devices.text(name)
        assert not window.devices.rows[name].reconnect.isVisible()
    # The others still do as they are told; pictures need all of them.
    person.chooses(window.settings.target, "star")
    person.waits(lambda: bench.last(BenchState).target == "star")
    person.waits(lambda: not window.actions_["live"].isChecked())
    window.message.acknowledge()
    person.presses(Qt.Key.Key_F5)
    person.waits(lambda: window.message.is_error)
    assert "click Reconnect" in window.message.text
    window.message.acknowledge()
    person.clicks(window.devices.rows["filter"].reconnect)
    person.waits(lambda: "ready" in window.devices.text("filter"))
    assert not window.devices.rows["filter"].reconnect.isVisible()
    assert "Filter is open again" in window.message.text
    person.presses(Qt.Key.Key_F5)
    person.waits(lambda: bench.frame is not None and bench.frame.target == "star")


@pytest.fixture
def paused_by_the_filter(own_bench, chosen_file, qtbot, tmp_path):
    """A run that pauses when its filter has hung as often as the plan allows."""
    bench = own_bench(hangs("filter", frame=2, times=2))
    person = Person(bench, qtbot)
    top = '[retry]\nattempts = 2\nthen = "pause"\n'
    chosen_file(write_plan(tmp_path, "Two colours", top=top, wavelengths="[500, 600]"))
    person.waits(lambda: bench.frames > 0)
    bench.window.actions_["plan"].trigger()
    person.waits(lambda: bench.states == ["PAUSED"])
    return bench, person


def test_a_run_that_a_device_stopped_goes_on_when_it_is_mended(paused_by_the_filter):
    bench, person = paused_by_the_filter
    assert bench.runs[0].stored_frames == 2
    assert "simulated tunable filter" in bench.window.prompt_bar.text
    person.waits(lambda: "failed" in bench.window.devices.text("filter"))
    # The run opens the device again itself.
    assert not bench.window.devices.rows["filter"].reconnect.isEnabled()
    person.presses(Qt.Key.Key_F8)
    person.waits(lambda: bench.states == ["COMPLETE"])
    person.waits(lambda: "failed" not in bench.window.devices.text("filter"))
    person.waits(lambda: bench.frame.target == "photograph")


def test_closing_the_window_in_a_run_leaves_the_bench_safe(paused_by_the_filter, monkeypatch):
    bench, _ = paused_by_the_filter
    asked = []
    answers = iter([QMessageBox.StandardButton.No, QMessageBox.StandardButton.Yes])
    monkeypatch.setattr(
        QMessageBox,
        "question",
        staticmethod(lambda *given: asked.append(given[2]) or next(answers)),
    )
    engine, path = bench.connection.process_id, bench.runs[0].path
    assert not bench.window.close()
    assert "A run is under way" in asked[0]
    assert bench.window.close()
    assert not alive(engine)
    with Record(path) as record:
        # It is only written once the bench has been made safe.
        assert record.state is State.CANCELLED
        assert len(record.missing_frames()) == 2


def test_a_device_that_is_unplugged_in_a_run_is_red_until_it_is_there_again(
    own_bench, chosen_file, qtbot, tmp_path
):
    """A VariSpec whose port goes; the run waits for it, and goes on by itself."""
    files = write_bench(tmp_path)
    line, port = SimulatedLine(VariSpecMachine(), baudrate=9600), tmp_path / "filter"
    table = f'driver = "varispec"\noptions = {{ port = "{port}" }}\nsimulated = true'
    text = files.bench.read_text()
    files.bench.write_text(text.replace('driver = "simulated-filter"', table))
    with PtyLine(line, port) as served:
        bench = own_bench(files=files)
        window, person = bench.window, Person(bench, qtbot)
        chosen_file(write_plan(tmp_path, "Darks", wavelengths="[500, 600]", repeats=5))
        window.actions_["plan"].trigger()
        person.waits(lambda: bench.stored > 2)
        line.inject(WireFault("disconnect", served.clock.now()))
        person.waits(lambda: "unplugged" in window.devices.text("filter"))
        assert "there any more" in window.devices.text("filter")
        person.waits(lambda: "UNPLUGGED: filter, VariSpec" in bench.runs[-1].message)
        assert "unplugged" not in window.devices.text("camera")
        line.clear_faults()
        person.waits(lambda: "in a run" in window.devices.text("filter"))
        person.waits(lambda: bench.states == ["COMPLETE"])
