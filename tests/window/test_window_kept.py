"""The queue comes back after a crash of the engine and after a restart, and none is lost."""

import os
import signal

import pytest
from plan_files import ASKS, write_plan
from waits import wait_until
from window_scene import write_bench

from labapp.runs.record.reader import Record
from labapp.runs.state import State
from labapp.window.commands import RunPlan


@pytest.fixture
def in_line(own_bench, tmp_path, chosen_file):
    """Three runs: one under way with frames stored, one that waits, one just asked for."""
    bench = own_bench()
    for title, asked in (
        ("First", {"top": ASKS, "targets": '["dark", "near"]', "repeats": 4}),
        ("Second", {}),
    ):
        chosen_file(write_plan(tmp_path, title, **asked))
        bench.window.actions_["plan"].trigger()
    wait_until(lambda: bench.states == ["PAUSED", "WAITING"], bench.describe)
    assert bench.stored == 8
    return bench


def require_held(bench, stored):
    window = bench.window
    wait_until(lambda: bench.states == ["WAITING", "WAITING"], bench.describe)
    assert window.queue.hold_bar.isVisible()
    assert "Nothing moves" in window.message.message
    assert [run.title for run in bench.runs] == ["First", "Second"]
    assert [run.stored_frames for run in bench.runs] == [stored, 0]


def require_taken(bench, path):
    """Let the queue go on: the first run's record gets what it lacks, and the second is taken."""
    bench.window.queue.release_button.click()
    wait_until(lambda: bench.window.prompt_bar.is_asking, bench.describe)
    bench.window.prompt_bar.done_button.click()
    wait_until(lambda: bench.states == ["COMPLETE", "COMPLETE"], bench.describe)
    assert bench.runs[0].path == path
    with Record(path) as record:
        assert record.state is State.COMPLETE
        assert "resumed: 8 frames to take" in [text for _, text in record.log]
    assert bench.window.kept_queue.requests == ()


def test_after_a_crash_of_the_engine(in_line):
    bench, path = in_line, in_line.runs[0].path
    os.kill(bench.connection.process_id, signal.SIGKILL)
    wait_until(lambda: bench.window.message.is_error, bench.describe)
    assert "2 runs come back in line" in bench.window.message.text
    bench.window.message.restart.click()
    require_held(bench, 8)
    require_taken(bench, path)


def test_after_a_restart_of_the_window(in_line, new_bench, tmp_path):
    bench, path = in_line, in_line.runs[0].path
    bench.window.settings.exposure.setValue(123.0)
    os.kill(bench.connection.process_id, signal.SIGKILL)
    wait_until(lambda: bench.window.message.is_error, bench.describe)
    bench.window.close()
    files = write_bench(tmp_path)
    again = new_bench(bench=files.bench, scene=files.scene)
    require_held(again, 8)
    assert again.window.settings.exposure.value() == 123.0
    require_taken(again, path)


def test_a_run_that_is_refused_is_not_kept(own_bench, tmp_path, chosen_file):
    bench = own_bench()
    chosen_file(tmp_path / "no-such-plan.toml")
    bench.window.actions_["plan"].trigger()
    assert isinstance(bench.window.kept_queue.requests[0].request, RunPlan)
    wait_until(lambda: bench.window.message.is_error, bench.describe)
    assert bench.window.kept_queue.requests == ()
