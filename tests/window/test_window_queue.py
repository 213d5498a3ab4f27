"""Runs in line: put there, paused, cancelled, removed and resumed, by clicks and keys."""

import numpy as np
import pytest
from plan_files import ASKS, LONG, write_plan
from PySide6.QtCore import Qt
from PySide6.QtGui import QColor

from labapp.runs.record.reader import Record
from labapp.runs.state import State
from labapp.window import theme
from labapp.window.messages import PatternPreview


@pytest.fixture
def queue(bench, person):
    """The queue's panel, with nothing in it."""
    panel = bench.window.queue
    if panel.clear.isEnabled():
        person.clicks(panel.clear)
    person.waits(lambda: bench.runs == [])
    return panel


@pytest.fixture
def run_plan(bench, chosen_file, tmp_path):
    """Choose a plan file to run."""

    def run(title, **asked):
        chosen_file(write_plan(tmp_path, title, **asked))
        bench.window.actions_["plan"].trigger()

    return run


def has_colour(person, table, row, column, name):
    """Whether the screen shows a colour in a cell of the table."""
    place = table.visualRect(table.model().index(row, column))
    seen = person.looks_at(table.viewport())
    cell = seen[place.top() : place.bottom(), place.left() : place.right()].astype(int)
    colour = QColor(name)
    wanted = np.array([colour.red(), colour.green(), colour.blue()])
    return (np.abs(cell - wanted).max(axis=2) < 12).any()


def test_runs_are_taken_one_after_the_other(bench, person, queue, run_plan):
    run_plan("First of all", top=ASKS, targets='["near"]', repeats=20)
    run_plan("Second: 2 frames")
    person.waits(lambda: bench.states == ["PAUSED", "WAITING"])
    table = queue.table
    person.waits(lambda: has_colour(person, table, 1, 1, theme.RUN_STATES[State.WAITING]))
    # The next run can be prepared, but the bench is taken.
    assert bench.window.actions_["acquire"].isEnabled()
    assert bench.window.pattern.form.isEnabled()
    assert not bench.window.settings.target.isEnabled()
    person.clicks(bench.window.prompt_bar.done_button)
    person.waits(lambda: bench.states == ["COMPLETE", "COMPLETE"])
    person.waits(lambda: has_colour(person, table, 1, 1, theme.RUN_STATES[State.COMPLETE]))
    first, second = bench.runs
    assert first.path.name.endswith("_first-of-all.h5")
    assert second.path.name.endswith("_second-2-frames.h5")
    assert (
        first.stored_frames,
        first.planned_frames,
        second.stored_frames,
        second.planned_frames,
    ) == (
        40,
        40,
        2,
        2,
    )
    with Record(first.path) as one, Record(second.path) as two:
        assert one.state is two.state is State.COMPLETE
        assert one.end_time <= two.text("start_time")
    # The queue is through: the person's own settings are back, and the picture is live.
    person.waits(lambda: bench.frame.target == "photograph" and bench.frame.exposure == 0.4)
    person.clicks(queue.clear)
    person.waits(lambda: bench.runs == [])


def test_the_same_bracket_twice_goes_to_two_files(bench, person, queue):
    for row in (bench.window.run.star, bench.window.run.photograph):
        person.types(row.count, "1")
    person.chooses(bench.window.pattern.form.kind, "Axicon")
    person.presses(Qt.Key.Key_F6)
    person.presses(Qt.Key.Key_F6)
    person.waits(lambda: bench.states == ["COMPLETE", "COMPLETE"])
    assert bench.runs[0].path != bench.runs[1].path
    person.waits(bench.window.actions_["reconstruct"].isEnabled)


def test_after_a_cancelled_run_the_queue_holds(bench, person, queue, run_plan):
    run_plan("Too long", top=ASKS, targets='["dark", "near"]')
    run_plan("Not wanted")
    run_plan("Wanted")
    person.waits(lambda: bench.states == ["PAUSED", "WAITING", "WAITING"])
    assert not queue.remove.isEnabled()
    person.selects(queue.table, 1)
    person.clicks(queue.remove)
    person.waits(lambda: [run.title for run in bench.runs] == ["Too long", "Wanted"])
    person.cancels()
    person.waits(lambda: bench.states == ["CANCELLED", "WAITING"])
    person.waits(queue.hold_bar.isVisible)
    assert queue.held_text.text() == "Held: Too long was cancelled. 1 run waits."
    person.waits(lambda: "stopped" in bench.window.devices.text("camera"))
    person.clicks(queue.release_button)
    person.waits(lambda: bench.states == ["CANCELLED", "COMPLETE"])
    assert not queue.hold_bar.isVisible()
    count = bench.frames
    person.waits(lambda: bench.frames > count + 2)


def test_pause_holds_and_resume_goes_on(bench, person, queue, run_plan):
    pause = bench.window.actions_["pause"]
    assert not pause.isEnabled()
    run_plan("Now and then", repeats=LONG)
    person.waits(lambda: bench.stored > 2)
    assert pause.iconText() == "Pause  F8"
    person.presses(Qt.Key.Key_F8)
    person.waits(lambda: bench.states == ["PAUSED"])
    assert pause.iconText() == "Resume  F8"
    assert bench.window.prompt_bar.text.startswith("PAUSED: paused by the user")
    person.waits(lambda: has_colour(person, queue.table, 0, 1, theme.RUN_STATES[State.PAUSED]))
    missing = not_stored(bench)
    # Nothing is taken while the engine computes something else.
    bench.reports.clear()
    person.chooses(bench.window.pattern.form.kind, "Letters")
    person.waits(lambda: bench.last(PatternPreview) is not None)
    assert not_stored(bench) == missing
    count, bar = bench.stored, bench.window.run.bar
    assert 0 < bar.value() < bar.maximum()
    times = bench.window.run.times.text()
    assert " elapsed" in times
    assert times.endswith("waits for you")
    person.clicks(bench.window.prompt_bar.resume_button)
    person.waits(lambda: bench.stored > count + 2)
    assert bench.states == ["RUNNING"]
    assert bench.window.prompt_bar.text == ""
    person.presses(Qt.Key.Key_F8)
    person.waits(lambda: bench.states == ["PAUSED"])
    person.clicks(bench.window.bar.buttons["cancel"])
    person.clicks(bench.window.question.yes_button)
    person.waits(lambda: bench.states == ["CANCELLED"])


def not_stored(bench):
    """Frames that the record of the run that was paused lacks."""
    with Record(bench.runs[0].path) as record:
        assert record.state is State.PAUSED
        return len(record.frames_not_stored())


def test_a_run_asks_and_waits_for_the_answer(bench, person, queue, run_plan):
    run_plan("Two places", top=ASKS, targets='["near", "far"]')
    call = bench.window.prompt_bar
    person.waits(lambda: call.text == "Place the star at 1.5 m, then press Enter.")
    person.waits(lambda: bench.states == ["PAUSED"])
    assert bench.stored == 0
    amber = np.array([0x4A, 0x3A, 0x14])
    person.waits(lambda: (person.looks_at(call) == amber).all(axis=2).mean() > 0.3)
    # Enter in a field is for the field; the next one is for the run.
    field = bench.window.run.folder
    person.types(field, field.text())
    assert call.text == "Place the star at 1.5 m, then press Enter."
    person.presses(Qt.Key.Key_Return)
    person.waits(lambda: call.text == "Place the star at 3 m, then press Enter.")
    person.waits(lambda: bench.stored == 2)
    person.clicks(call.done_button)
    person.waits(lambda: bench.states == ["COMPLETE"])
    assert call.text == ""


def test_cancel_at_a_prompt_cancels(bench, person, queue, run_plan):
    run_plan("Two places", top=ASKS, targets='["near", "far"]')
    person.waits(lambda: bench.window.prompt_bar.is_asking)
    person.cancels()
    person.waits(lambda: bench.states == ["CANCELLED"])
    assert bench.window.prompt_bar.text == ""
    with Record(bench.runs[0].path) as record:
        assert record.state is State.CANCELLED


def test_a_cancelled_run_is_resumed(bench, person, queue, run_plan, chosen_file):
    run_plan("In two goes", top=ASKS, targets='["dark", "near"]', repeats=5)
    person.waits(lambda: bench.window.prompt_bar.is_asking)
    person.cancels()
    person.waits(lambda: bench.states == ["CANCELLED"])
    path = bench.runs[0].path
    assert bench.runs[0].stored_frames == 10
    chosen_file(path)
    person.clicks(queue.buttons["resume"])
    person.waits(lambda: bench.window.prompt_bar.is_asking)
    person.presses(Qt.Key.Key_Return)
    person.waits(lambda: bench.states == ["CANCELLED", "COMPLETE"])
    again = bench.runs[1]
    assert (again.path, again.title) == (path, "In two goes")
    assert again.stored_frames == again.planned_frames == 20
    with Record(path) as record:
        assert record.state is State.COMPLETE
        # Only what was missing was taken in the second go.
        texts = [text for _, text in record.log]
        assert "resumed: 10 frames to take" in texts


def test_a_plan_that_the_bench_cannot_run_is_refused_before_it_waits(
    bench, person, queue, run_plan
):
    run_plan("Infrared", wavelengths="[1550]")
    person.waits(lambda: bench.window.message.is_error)
    assert "Choose 420 to 720 nm" in bench.window.message.text
    assert bench.runs == []


def test_a_wavelength_chosen_during_a_run_is_for_what_follows(bench, person, queue, run_plan):
    run_plan("At 550 nm", top=ASKS, targets='["near", "far"]')
    person.waits(lambda: bench.window.prompt_bar.is_asking)
    person.types(bench.window.settings.wavelength, "620")
    bench.reports.clear()
    bench.picture = None
    person.clicks(bench.window.prompt_bar.done_button)
    person.waits(lambda: bench.stored == 2 and bench.frame is not None)
    assert round(bench.frame.wavelength * 1e9) == 550
    person.waits(lambda: bench.window.prompt_bar.is_asking)
    run_plan("Short")
    person.cancels()
    person.waits(queue.release_button.isVisible)
    person.clicks(queue.release_button)
    person.waits(lambda: bench.states == ["CANCELLED", "COMPLETE"])
    person.waits(lambda: round(bench.frame.wavelength * 1e9) == 620)
