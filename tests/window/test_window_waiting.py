"""Live pictures while a run waits for a person: they come, and the record has no trace of them."""

import numpy as np
from plan_files import ASKS, LONG, write_plan
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest

from labapp.runs.record import layout
from labapp.runs.record.reader import Record
from labapp.window.measuring_messages import ExposureFound
from labapp.window.messages import RunEnded


def test_live_goes_on_while_a_run_asks_and_leaves_no_trace(
    bench, person, align, chosen_file, tmp_path
):
    """The record is the same as of a run in which nobody looks."""
    records = []
    for looks in (False, True):
        bench.reports.clear()
        chosen_file(write_plan(tmp_path, f"Asks {looks}", top=ASKS, targets='["near", "far"]'))
        bench.window.actions_["plan"].trigger()
        for place in ("1.5 m", "3 m"):
            person.waits(lambda place=place: asks_for(bench, place))
            person.waits(bench.window.settings.exposure.isEnabled)
            if looks:
                look_around(bench, person, align)
            else:
                person.waits(bench.window.actions_["live"].isChecked)
                person.presses(Qt.Key.Key_F5)
                sees_nothing(bench, person)
            person.clicks(bench.window.prompt_bar.done_button)
            person.waits(lambda place=place: not asks_for(bench, place))
        person.waits(lambda: bench.last(RunEnded) is not None)
        assert bench.last(RunEnded).state == "COMPLETE"
        records.append(bench.last(RunEnded).path)
    with Record(records[0]) as one, Record(records[1]) as two:
        assert one.frame_count == two.frame_count == 4
        for index in range(4):
            assert np.array_equal(one.image(index), two.image(index))
        for name in {*layout.PLANNED, *layout.MEASURED} - {*layout.UNSEEDED}:
            assert np.array_equal(one.column(name), two.column(name)), name


def asks_for(bench, place):
    """Whether the run asks for the star at that place."""
    bar = bench.window.prompt_bar
    return bar.is_asking and f"at {place}," in bar.text


def sees_nothing(bench, person):
    """The pictures have stopped, and none that was on its way looks like a live one."""
    caption = bench.window.live_view.caption
    person.waits(lambda: "STOPPED" in caption.text())
    count = bench.frames
    QTest.qWait(200)
    assert bench.frames == count
    assert "STOPPED" in caption.text()


def look_around(bench, person, align):
    """See pictures come, at an exposure of one's own, and have another one found."""
    count, view = bench.frames, bench.window.live_view
    person.waits(lambda: bench.frames > count + 3 and "STOPPED" not in view.caption.text())
    assert not bench.window.settings.target.isEnabled()
    person.types(bench.window.settings.exposure, "3")
    person.waits(lambda: bench.frame.exposure == 3e-3)
    bench.reports.clear()
    person.clicks(align.expose)
    person.waits(lambda: bench.last(ExposureFound) is not None)
    person.waits(lambda: bench.frame.exposure == bench.last(ExposureFound).exposure)


def test_live_goes_on_in_a_pause(bench, person, align, chosen_file, tmp_path):
    chosen_file(write_plan(tmp_path, "Paused", repeats=LONG))
    bench.window.actions_["plan"].trigger()
    person.waits(lambda: bench.stored > 2)
    assert not bench.window.settings.exposure.isEnabled()
    assert not align.expose.isEnabled()
    person.presses(Qt.Key.Key_F8)
    person.waits(lambda: bench.states[-1] == "PAUSED")
    stored, count = bench.stored, bench.frames
    person.waits(lambda: bench.frames > count + 5)
    person.waits(align.expose.isEnabled)
    person.types(bench.window.settings.exposure, "5")
    person.waits(lambda: bench.frame.exposure == 5e-3)
    assert bench.stored == stored
    person.presses(Qt.Key.Key_F8)
    person.waits(lambda: bench.stored > stored + 2)
    person.waits(lambda: not bench.window.settings.exposure.isEnabled())
    person.cancels()
    person.waits(lambda: bench.states[-1] == "CANCELLED")
    with Record(bench.runs[-1].path) as record:
        taken = record.column("exposure")[: bench.runs[-1].stored_frames]
    assert set(np.round(taken * 1e3, 3)) == {1.0}
