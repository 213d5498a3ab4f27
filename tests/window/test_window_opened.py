"""Every run that the window has taken can be opened: it is seen, and restored if it can be."""

import h5py
import numpy as np
import pytest
from plan_files import ASKS, write_plan
from test_window_run import acquire_small

from labapp.runs.record.reader import Record
from labapp.window.messages import ReconstructionResult


@pytest.fixture
def opens(bench, person, chosen_file):
    def open_(path):
        bench.reports.clear()
        bench.window.tabs.setCurrentWidget(bench.window.live_view)
        chosen_file(path)
        person.clicks(bench.window.queue.buttons["open"])
        view = bench.window.reconstruction
        person.waits(lambda: bench.window.tabs.currentWidget() is view)
        return view

    return open_


def taken(bench, person, chosen_file, plan):
    """The record of a plan that the window has run."""
    ended = sum(run.state.has_ended for run in bench.runs)
    chosen_file(plan)
    bench.window.actions_["plan"].trigger()
    person.waits(lambda: sum(run.state.has_ended for run in bench.runs) > ended)
    person.waits(bench.window.actions_["open"].isEnabled)
    return bench.runs[-1].path


def test_a_run_of_the_star_alone_is_seen(bench, person, opens, chosen_file, tmp_path):
    path = taken(bench, person, chosen_file, write_plan(tmp_path, "Star alone", targets='["star"]'))
    view = opens(path)
    person.waits(lambda: view.note.text().startswith("Star alone: COMPLETE, 2 of 2 frames"))
    said = view.note.text()
    assert "targets star; patterns neutral; 550 nm." in said
    assert "Shown: frame 1: star, neutral, 550.00 nm, 8 ms." in said
    assert "Not restored: it has no photograph" in said
    assert not bench.window.message.is_error
    person.waits(lambda: person.looks_at(view.picture).max() > 200)
    # As in the record itself: bright in few pixels, and dark around them.
    with Record(path) as record:
        raw = record.image(1)
    assert raw.max() - 64 > 20 * abs(np.median(raw) - 64)


def test_dark_frames_and_a_photograph_without_a_star_are_seen(
    bench, person, opens, chosen_file, tmp_path
):
    for target, why in (
        ("dark", "it has no photograph"),
        ("photograph", "it has no star 'star' with the pattern of a photograph"),
    ):
        plan = write_plan(tmp_path, f"Of {target}", targets=f'["{target}"]')
        view = opens(taken(bench, person, chosen_file, plan))
        note = view.note
        person.waits(lambda words=why, note=note: f"Not restored: {words}" in note.text())
        assert f"Shown: frame 1: {target}" in view.note.text()
        assert not bench.window.message.is_error


def test_a_cancelled_run_is_seen_as_far_as_it_came(bench, person, opens, chosen_file, tmp_path):
    plan = write_plan(tmp_path, "Given up", top=ASKS, targets='["dark", "near"]')
    chosen_file(plan)
    bench.window.actions_["plan"].trigger()
    person.waits(lambda: bench.window.prompt_bar.is_asking)
    person.cancels()
    person.waits(lambda: bench.states[-1] == "CANCELLED")
    view = opens(bench.runs[-1].path)
    person.waits(lambda: view.note.text().startswith("Given up: CANCELLED, 2 of 4 frames"))


def test_a_bracket_is_restored_when_it_is_opened(bench, person, opens):
    path = acquire_small(bench, person).path
    person.waits(bench.window.actions_["open"].isEnabled)
    opens(path)
    person.waits(lambda: bench.last(ReconstructionResult) is not None)
    assert bench.last(ReconstructionResult).path == path
    person.waits(lambda: "Residual" in bench.window.reconstruction.note.text())


def test_a_file_that_is_no_record_is_an_error(bench, person, chosen_file, tmp_path):
    other = tmp_path / "other.h5"
    with h5py.File(other, "w") as file:
        file["numbers"] = np.arange(3)
    chosen_file(other)
    person.clicks(bench.window.queue.buttons["open"])
    person.waits(lambda: bench.window.message.is_error)
    assert str(other) in bench.window.message.text
