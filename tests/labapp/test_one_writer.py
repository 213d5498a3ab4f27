"""A file that a run writes is nobody else's until the run has ended."""

from __future__ import annotations

import errno
import os

import pytest
from figures.one_file import contest, work
from figures.rivals import Rivals
from plans import block, plan_of

from labapp.bench.opening import open_bench
from labapp.common.errors import UserError
from labapp.files.write_locks import is_locked, move_into_place, open_locked
from labapp.files.writing import require_writable, write_atomically
from labapp.runs.acquisition.attendance import Attendance
from labapp.runs.acquisition.runner import hold_record, resume_run, run_plan
from labapp.runs.record.reader import Record
from labapp.runs.state import State

PLAN = plan_of(block(targets=["dark"], repeats=4))

MINE = rf"is being written by process {os.getpid()} on "


@pytest.fixture
def bench(small):
    with open_bench(small.bench_files) as opened:
        yield opened


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run.h5"


@pytest.mark.parametrize("schedules", [5, pytest.param(60, marks=pytest.mark.sweep)])
def test_two_processes_that_want_one_file_lose_no_frame(tmp_path, schedules):
    """Another seed than the figure's."""
    found = contest(tmp_path, schedules, seed=1)
    assert [one.wrong for one in found if one.wrong] == []
    assert sum(one.lost for one in found) == 0
    assert sum(one.frames for one in found) > 3 * schedules


@pytest.mark.parametrize("what", ["run", "run --force"])
def test_of_two_runs_that_begin_at_once_one_at_least_writes_and_the_other_is_told(what, tmp_path):
    path = tmp_path / "run.h5"
    with Rivals() as rivals:
        works = [work(what, title, path, path, number) for number, title in enumerate("ab")]
        deeds = rivals.take(*works)
    won = [deed for deed in deeds if deed.state == State.COMPLETE]
    told = [deed for deed in deeds if deed.error]
    assert len(won) + len(told) == 2
    # With --force, a run that begins after the other has ended may replace its record.
    one_after_the_other = max(d.first for d in won) > min(d.last for d in won)
    assert len(won) == 1 or (what == "run --force" and one_after_the_other)
    with Record(path) as record:
        assert record.text("title") == max(won, key=lambda deed: deed.placed).title


def test_whatever_writes_files_is_told_who_has_the_record(bench, path, tmp_path):
    def intrude(shot, frame):
        other = tmp_path / "other"
        other.write_text("something else")
        for write in (
            lambda: run_plan(bench, PLAN, path, force=True),
            lambda: resume_run(bench, path),
            lambda: require_writable(path, force=True),
            lambda: write_atomically(path, b"something else"),
            lambda: move_into_place(other, path, force=True),
        ):
            with pytest.raises(UserError, match=MINE):
                write()
        with pytest.raises(UserError, match="exists already"):
            move_into_place(other, path, force=False)

    assert run_plan(bench, PLAN, path, Attendance(on_frame=intrude)).state is State.COMPLETE
    assert not is_locked(path)
    write_atomically(path, b"something else")
    assert path.read_bytes() == b"something else"


def test_a_record_is_held_from_its_verification_to_the_end_of_its_resumption(bench, path):
    run_plan(bench, PLAN, path)
    with hold_record(path) as held:
        assert held.missing == []
        with pytest.raises(UserError, match=MINE):
            run_plan(bench, PLAN, path, force=True)
        resume_run(bench, held)
        assert is_locked(path)
    assert not is_locked(path)


def test_a_run_whose_file_is_moved_fails_and_says_where_its_frames_are(bench, path, tmp_path):
    moved = tmp_path / "moved.h5"

    def move(shot, frame):
        if shot.index == 1:
            path.rename(moved)

    outcome = run_plan(bench, PLAN, path, Attendance(on_frame=move))
    assert (outcome.state, outcome.path, outcome.missing) == (State.FAILED, moved, [])
    assert outcome.message.endswith(f"Its frames are in {moved}")
    assert not path.exists()
    with Record(moved) as record:
        assert (record.state, record.missing_frames()) == (State.FAILED, [])
        assert "moved, deleted or replaced" in record.message
    assert resume_run(bench, moved).state is State.COMPLETE


@pytest.mark.parametrize("replaced", [False, True])
def test_a_run_whose_file_is_deleted_ends_and_keeps_its_frames(bench, path, replaced):
    """By a command that knows nothing of locks."""
    copy = path.with_name("run_rescued_1.h5")

    def delete(shot, frame):
        if shot.index == 1:
            path.unlink()
            if replaced:
                path.write_text("another file")

    outcome = run_plan(bench, PLAN, path, Attendance(on_frame=delete))
    assert (outcome.state, outcome.path, outcome.missing) == (State.FAILED, copy, [2, 3])
    assert outcome.message.endswith(f"Its frames are in {copy}")
    assert not replaced or path.read_text() == "another file"
    with Record(copy) as record:
        assert (record.state, record.missing_frames()) == (State.FAILED, [2, 3])
    assert resume_run(bench, copy).state is State.COMPLETE


def test_a_file_that_is_deleted_by_the_last_frame_is_noticed(bench, path):
    outcome = run_plan(
        bench, PLAN, path, Attendance(on_frame=lambda shot, _: shot.index == 3 and path.unlink())
    )
    assert (outcome.state, outcome.missing) == (State.FAILED, [])
    assert outcome.path == path.with_name("run_rescued_1.h5")


@pytest.mark.parametrize("code", [errno.EPERM, errno.EOPNOTSUPP])
def test_a_file_system_without_second_names_has_records_all_the_same(
    bench, path, code, monkeypatch
):
    def refuse(*names):
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(os, "link", refuse)
    assert run_plan(bench, PLAN, path).state is State.COMPLETE
    with pytest.raises(UserError, match="exists already"):
        run_plan(bench, PLAN, path)
    assert run_plan(bench, PLAN, path, force=True).state is State.COMPLETE
    assert list(path.parent.glob("*run.h5*")) == [path]


def test_a_link_to_nowhere_is_replaced_as_a_file_is(path, tmp_path):
    path.symlink_to(tmp_path / "nowhere")
    write_atomically(path, b"here")
    assert path.read_bytes() == b"here"
    assert not path.is_symlink()


def test_what_is_no_plain_file_is_not_written(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for write in (lambda: require_writable(pipe, force=True), lambda: os.close(open_locked(pipe))):
        with pytest.raises(UserError, match="isn't a plain file"):
            write()


def test_drafts_of_processes_that_are_gone_are_removed_unless_somebody_writes_them(path):
    gone, written = (path.with_name(f".run.h5.{2**22 + number}.new") for number in range(2))
    for draft in (gone, written):
        draft.touch()
    handle = open_locked(written)
    write_atomically(path, b"")
    assert sorted(path.parent.glob(".*.new")) == [written]
    os.close(handle)
