"""Runs on a panel's screen whose card somebody else sets while a frame is exposed."""

from __future__ import annotations

import threading
import time

import pytest
from figures.connector_properties import connector
from figures.plugs import screen
from figures.spoiled_screens import listening
from figures.unplug import plan_of

from drivers.x11 import XConnection
from drivers.x11.outputs import list_outputs
from labapp.bench.opening import open_bench
from labapp.runs.acquisition.attendance import Attendance
from labapp.runs.acquisition.runner import run_plan
from labapp.runs.record.reader import Record
from labapp.runs.state import State

BROADCAST = ["Automatic", "Full", "Limited 16:235"]


@pytest.mark.xvfb
@pytest.mark.parametrize("is_brief", [False, True])
def test_a_frame_whose_levels_were_altered_is_named_and_taken_again(tmp_path, is_brief):
    """The second frame of the plan is exposed for longer than a second; the others aren't touched.

    Brief: the property is set back while the frame is still exposed.
    """
    changed: list[float] = []
    accepted: list[float] = []
    with screen(tmp_path) as plug:
        display = plug.setup.bench.devices.slm.options["display"]
        with XConnection(display) as x:
            number = list_outputs(x)[0].number
        with connector(display, number) as made, listening() as ear:
            made.make("Broadcast RGB", BROADCAST, "Full")
            made.make("max bpc", [6, 16], [6], is_range=True)

            def spoil():
                changed.append(time.monotonic())
                made.set("Broadcast RGB", "Limited 16:235")
                if is_brief:
                    made.set("Broadcast RGB", "Full")

            def look(shot, frame):
                accepted.append(time.monotonic())
                if shot.index == 0:
                    threading.Timer(0.3, spoil).start()

            with open_bench(plug.setup) as bench:
                plan = plan_of(["neutral"])
                outcome = run_plan(bench, plan, tmp_path / "run.h5", Attendance(on_frame=look))
    assert outcome.state is State.COMPLETE
    with Record(outcome.path) as record:
        assert list(record.column("attempts")) == [1, 2, 1, 1]
        # What was set when the bench was opened, before the run began, is in its record.
        assert len([line for line in record.log if "max bpc is set from 6 to 8" in line[1]]) == 1
    assert ear.named("Broadcast RGB", changed[0], accepted[1])
