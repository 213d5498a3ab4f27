"""Runs on real drivers whose devices are unplugged and plugged in again."""

import threading

import pytest
from figures import plugs
from figures.unplug import plan_of, unplugged_run

from labapp.bench.opening import open_bench
from labapp.runs.acquisition.attendance import Attendance
from labapp.runs.acquisition.runner import run_plan
from labapp.runs.state import State
from optics.progress import Progress


def _ends_well(make, folder):
    """Unplugged while the second frame is exposed, which takes longer than it may be unnoticed."""
    run = unplugged_run(make, folder / "run", 1, 0.1, ["lens"])
    assert (run.state, run.right) == (State.COMPLETE, run.asked)
    assert run.again >= 1
    assert 0 <= run.named < float("inf")
    return run


@pytest.mark.parametrize(
    "make",
    [
        plugs.zwo,
        plugs.x_server,
        pytest.param(plugs.varispec, marks=pytest.mark.sweep),
        pytest.param(plugs.screen, marks=pytest.mark.sweep),
    ],
)
def test_it_is_named_and_the_run_goes_on(make, tmp_path):
    """And a person is told while the camera still exposes."""
    run = _ends_well(make, tmp_path)
    told = [words for words in run.said if "UNPLUGGED" in words]
    assert told[0].endswith("1200 ms)")
    assert "UNPLUGGED" not in run.said[-1]


@pytest.mark.aravis
def test_the_camera_is_named_and_the_run_goes_on(tmp_path):
    _ends_well(plugs.gige, tmp_path)


def test_a_run_that_waits_for_a_plug_can_be_cancelled(tmp_path):
    progress = Progress()

    with plugs.zwo(tmp_path) as plug, open_bench(plug.setup) as bench:

        def pull(shot, frame):
            plug.pull(1e3)
            # By then the next frame is exposed, refused, and its wheel waited for.
            threading.Timer(2.5, progress.cancel).start()

        plan = plan_of(["neutral"])
        outcome = run_plan(
            bench, plan, tmp_path / "run.h5", Attendance(progress=progress, on_frame=pull)
        )
    assert outcome.state is State.CANCELLED
    assert outcome.missing == [1, 2, 3]
