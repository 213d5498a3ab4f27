"""The queue by itself: order, hold, what may be taken back; and the time that is left."""

from pathlib import Path
from threading import Thread

import pytest

from labapp.runs.state import State
from labapp.window.engine.frame_costs import FrameCosts
from labapp.window.engine.person_prompter import PersonPrompter
from labapp.window.engine.queued_run import QueuedRun
from labapp.window.engine.run_queue import RunQueue
from labapp.window.engine.timing import RunTiming
from optics.progress import Cancelled, Progress


def make_run(name):
    timing = RunTiming([], virtual=True, costs=FrameCosts(Path("no-such-file"), "bench"))
    return QueuedRun(
        name, Path(f"{name}.h5"), lambda **_: None, timing, planned_frames=5, stored_frames=0
    )


@pytest.fixture
def queue():
    """Three runs in line."""
    made = RunQueue(lambda: None)
    for name in ("one", "two", "three"):
        made.add(make_run(name))
    return made


def states(queue):
    return [info.state.value for info in queue.run_infos()]


def test_the_next_run_begins_after_a_complete_one(queue):
    run = queue.begin()
    assert states(queue) == ["RUNNING", "WAITING", "WAITING"]
    queue.end(run, State.COMPLETE, "")
    assert queue.begin().title == "two"
    assert states(queue) == ["COMPLETE", "RUNNING", "WAITING"]


@pytest.mark.parametrize("state", [State.CANCELLED, State.FAILED])
def test_after_a_bad_end_the_others_wait_until_somebody_says_so(queue, state):
    queue.end(queue.begin(), state, "why")
    assert queue.hold_reason.startswith("one ")
    assert queue.begin() is None
    queue.add(make_run("four"))
    assert queue.begin() is None
    queue.release()
    assert queue.begin().title == "two"


def test_the_last_run_holds_nobody(queue):
    queue.remove([2, 3])
    queue.end(queue.begin(), State.FAILED, "why")
    assert queue.hold_reason == ""
    queue.add(make_run("four"))
    assert queue.begin().title == "four"


def test_only_runs_that_wait_are_removed_and_only_ended_ones_cleared(queue):
    queue.end(queue.begin(), State.COMPLETE, "")
    queue.begin()
    queue.remove([1, 2, 3])
    assert states(queue) == ["COMPLETE", "RUNNING"]
    queue.clear()
    assert states(queue) == ["RUNNING"]


def test_who_takes_all_that_wait_out_ends_the_hold(queue):
    queue.end(queue.begin(), State.CANCELLED, "")
    queue.remove([2, 3])
    assert queue.hold_reason == ""


def test_cancel_reaches_the_run_under_way_and_no_other(queue):
    run = queue.begin()
    queue.cancel()
    assert run.progress.is_cancelled
    assert states(queue) == ["RUNNING", "WAITING", "WAITING"]


def test_cancel_reaches_a_run_that_is_about_to_begin(queue):
    queue.cancel()
    assert states(queue) == ["CANCELLED", "WAITING", "WAITING"]
    assert queue.begin() is None
    # Nobody is about to begin now.
    queue.cancel()
    assert states(queue) == ["CANCELLED", "WAITING", "WAITING"]


def test_a_run_that_was_asked_for_before_a_bad_end_waits_with_the_others(queue):
    """However long it takes to be read and checked."""
    queue.remove([2, 3])
    run = queue.begin()
    queue.expect_run()
    queue.cancel()
    queue.end(run, State.CANCELLED, "")
    assert queue.hold_reason == "one was cancelled"
    queue.add(make_run("four"))
    assert queue.begin() is None
    queue.release()
    assert queue.begin().title == "four"


def test_a_run_that_never_comes_holds_nobody(queue):
    queue.remove([2, 3])
    run = queue.begin()
    queue.expect_run()
    queue.end(run, State.FAILED, "")
    queue.drop_expected()
    assert queue.hold_reason == ""


def test_cancel_reaches_a_run_that_is_still_being_made_ready():
    queue = RunQueue(lambda: None)
    queue.cancel()
    queue.expect_run()
    queue.add(make_run("one"))
    assert states(queue) == ["WAITING"]
    queue.end(queue.begin(), State.COMPLETE, "")
    queue.expect_run()
    queue.expect_run()
    queue.cancel()
    queue.add(make_run("two"))
    queue.add(make_run("three"))
    assert states(queue) == ["COMPLETE", "CANCELLED", "WAITING"]
    assert queue.hold_reason == "two was cancelled"


def test_a_file_is_taken_as_long_as_its_run_has_not_ended(queue):
    assert queue.has_record(Path("one.h5"))
    queue.end(queue.begin(), State.CANCELLED, "")
    assert not queue.has_record(Path("one.h5"))


def test_what_a_run_says_of_its_rest_is_its_state():
    run = make_run("one")
    run.mark_started()
    run.progress.report(0.5, "dark, neutral, 550 nm, 8 ms")
    assert (run.info.state, run.info.message) == ("RUNNING", "dark, neutral, 550 nm, 8 ms")
    run.set_paused(True)
    assert (run.info.state, run.info.pause_requested) == ("RUNNING", True)
    run.progress.report(0.5, "PAUSED: paused by the user")
    assert (run.info.state, run.info.message) == ("PAUSED", "paused by the user")
    run.set_paused(False)
    assert (run.info.state, run.info.pause_requested) == ("RUNNING", False)


def test_an_answer_to_an_earlier_prompt_is_none():
    person = PersonPrompter(lambda: None)
    progress = Progress()
    asked = []

    def ask():
        try:
            person.ask("Place the star.", progress)
            asked.append("answered")
        except Cancelled:
            asked.append("cancelled")

    for number, end, how in (
        (1, lambda: person.answer(1), "answered"),
        (2, progress.cancel, "cancelled"),
    ):
        thread = Thread(target=ask)
        thread.start()
        while person.prompt is None:
            pass
        assert person.prompt.number == number
        person.answer(number - 1)
        thread.join(0.2)
        assert thread.is_alive()
        end()
        thread.join()
        assert asked.pop() == how
        assert person.prompt is None
