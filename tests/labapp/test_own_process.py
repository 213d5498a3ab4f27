"""A real camera beside simulated devices, in a process that can be killed when it hangs."""

from __future__ import annotations

import threading
import time
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest

import labapp.bench.driver_loading
from labapp.bench.driver_loading import DRIVER_GROUP
from labapp.bench.opening import open_bench
from labapp.common.errors import UserError
from labapp.files.plan_file import PlanFile
from labapp.files.reading import read_file
from labapp.runs.acquisition.attendance import Attendance
from labapp.runs.acquisition.runner import run_plan
from labapp.runs.record.reader import Record
from labapp.runs.state import State
from optics.progress import Progress

CAMERA = EntryPoint("strange-camera", "small_bench.strange_camera:StrangeCamera", DRIVER_GROUP)


@pytest.fixture
def strange(small, tmp_path, monkeypatch):
    """The bench files with a third party's camera in place of the simulated one."""
    known = labapp.bench.driver_loading.installed_drivers()
    monkeypatch.setattr(
        labapp.bench.driver_loading, "installed_drivers", lambda: known | {CAMERA.name: CAMERA}
    )
    text = small.bench.read_text().replace(
        'driver = "simulated-camera"',
        f'driver = "strange-camera"\noptions = {{ hang = "{tmp_path / "hang"}" }}\n'
        "own_process = true",
    )
    small.bench.write_text(text)
    return small


def test_a_camera_in_its_own_process_takes_a_plan_in_the_walls_time(strange, tmp_path):
    plan = read_file(strange.plan, PlanFile)
    with open_bench(strange.bench_files) as bench:
        assert bench.simulated_devices == ["slm", "filter", "targets"]
        outcome = run_plan(bench, plan, tmp_path / "run.h5")
    assert outcome.state is State.COMPLETE
    with Record(outcome.path) as record:
        # The camera counts its frames; those that measured the bench's delays came before.
        numbers = [int(record.image(i)[0, 0]) for i in range(16)]
        assert numbers == list(range(numbers[0], numbers[0] + 16))
        assert np.diff(record.column("time")).min() > 0
        # The clock's own times, not the plan's.
        assert record.column("time")[-1] >= record.expected_seconds - 16 * 0.01
        assert record.simulated_devices == ["filter", "slm", "targets"]


def test_a_camera_that_hangs_is_killed_named_and_opened_again(strange, tmp_path):
    plan = read_file(strange.plan, PlanFile)
    hang = tmp_path / "hang"

    def hang_once(shot, frame):
        if shot.index == 4:
            hang.touch()

    def mend():
        while not (hang.exists() and hang.read_text()):
            time.sleep(0.01)
        pids.append(int(hang.read_text()))
        hang.unlink()

    pids: list[int] = []
    mending = threading.Thread(target=mend)
    mending.start()
    with open_bench(strange.bench_files) as bench:
        outcome = run_plan(bench, plan, tmp_path / "run.h5", Attendance(on_frame=hang_once))
        assert not Path("/proc", str(pids[0])).exists()
    mending.join()
    assert outcome.state is State.COMPLETE
    with Record(outcome.path) as record:
        assert record.column("attempts").tolist() == [1] * 5 + [2] + [1] * 10
        words = next(text for _, text in record.log if "attempt 1 of 3" in text)
    assert "strange camera: capture: hangs" in words
    assert "it was killed" in words


def test_a_cancelled_run_names_the_camera_that_hangs(strange, tmp_path):
    plan, progress, hang = read_file(strange.plan, PlanFile), Progress(), tmp_path / "hang"

    def hang_and_cancel(shot, frame):
        hang.touch()
        threading.Thread(target=cancel).start()

    def cancel():
        while not hang.read_text():
            time.sleep(0.01)
        progress.cancel()

    with open_bench(strange.bench_files) as bench:
        outcome = run_plan(
            bench,
            plan,
            tmp_path / "run.h5",
            Attendance(progress=progress, on_frame=hang_and_cancel),
        )
    assert outcome.state is State.CANCELLED
    assert outcome.message.startswith("cancelled by the user; the camera hung at capture")


def test_simulated_devices_share_a_world_and_have_no_process(small):
    text = small.bench.read_text().replace(
        'driver = "simulated-camera"', 'driver = "simulated-camera"\nown_process = true'
    )
    small.bench.write_text(text)
    with pytest.raises(UserError, match=r"devices.camera.own_process' is true, .* Remove it"):
        open_bench(small.bench_files).__enter__()
