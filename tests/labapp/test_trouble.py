"""What the figures measure in hundreds, in tens: kills, full disks, faults, cancelled runs."""

from __future__ import annotations

from typing import get_args

import pytest
from figures.durability import kill_often
from figures.full_disk import fill_often
from figures.promptness import cancel_seconds
from figures.troubles import suffer
from small_bench.setups import small_setup

from labapp.runs.state import State
from simulator.faults import Fault, Kind


def few_or(many: int) -> pytest.MarkDecorator:
    """One trial, and in a sweep many."""
    return pytest.mark.parametrize("trials", [1, pytest.param(many, marks=pytest.mark.sweep)])


@few_or(8)
def test_no_kill_loses_an_acknowledged_frame_and_every_run_goes_on(tmp_path, trials):
    """Another seed than the figure's: these are other plans and other moments."""
    found = kill_often(tmp_path, trials, seed=1)
    assert len(found) == trials
    assert [one.wrong for one in found if one.wrong] == []
    assert sum(one.lost for one in found) == 0
    # Of runs that were killed before a frame was stored nothing would be learnt.
    assert trials == 1 or sum(one.acknowledged for one in found) > trials


@few_or(4)
def test_a_disk_that_runs_full_loses_nothing_and_the_run_waits_for_space(tmp_path, trials):
    troubles, paused = fill_often(tmp_path, trials, seed=1)
    if troubles is None:
        pytest.skip("a small file system can't be mounted here; test_runner.py fakes one")
    assert troubles == []
    assert paused > trials // 2


@few_or(2)
@pytest.mark.parametrize("kind", get_args(Kind))
def test_a_fault_ends_in_the_right_state_and_never_in_a_wrong_frame(kind, tmp_path, trials):
    """Judged by an undisturbed run of the same plan: every stored frame is the same one."""
    found = suffer(tmp_path, [kind], trials, seed=1)
    assert [(one.fault, one.wrong) for one in found if one.wrong] == []
    assert {one.state for one in found} <= {State.COMPLETE, State.FAILED}


def test_a_hung_camera_does_not_keep_a_cancelled_run_from_ending(tmp_path):
    """It would be waited for longer than any test may take; all is safe long before."""
    hung = small_setup(faults=[Fault("camera", "hung")], reply_s=600.0)
    assert cancel_seconds(tmp_path, hung, 0) < 600
