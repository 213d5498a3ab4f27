"""When a record is on the disk, by the order of its writes and syncs, and where the disk fails."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import h5py
import numpy as np
import pytest
from small_bench.files import SmallFiles

from labapp.bench.opening import open_bench
from labapp.common.errors import UserError
from labapp.files.hdf5_output import DraftFile
from labapp.files.plan_file import PlanFile
from labapp.files.reading import read_file
from labapp.files.write_locks import close_locked
from labapp.files.writing import write_atomically
from labapp.runs.acquisition.attendance import Attendance
from labapp.runs.acquisition.record_contents import build_record_contents
from labapp.runs.acquisition.runner import resume_run, run_plan
from labapp.runs.capabilities import BenchCapabilities
from labapp.runs.record import creation, disk_sync
from labapp.runs.record.creation import RecordContents, create_record
from labapp.runs.record.reader import Record
from labapp.runs.state import State
from labapp.runs.steps import planned_shots
from labapp.runs.verifying import verify


class Disk:
    """What a run asks of the system, in order; syncs fail where they are told to."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.events: list[str] = []
        self.fails_from = -1
        self.cause = errno.EIO
        self._syncs = 0
        write, sync = os.pwrite, os.fdatasync

        def pwrite(handle: int, data: bytes, offset: int) -> int:
            self.events.append("COMPLETE" if b"COMPLETE" in bytes(data)[:16] else "write")
            return write(handle, data, offset)

        def fdatasync(handle: int) -> None:
            self._syncs += 1
            if self._syncs == self.fails_from:
                raise OSError(self.cause, os.strerror(self.cause))
            sync(handle)
            self.events.append("sync")

        monkeypatch.setattr(os, "pwrite", pwrite)
        monkeypatch.setattr(os, "fdatasync", fdatasync)
        monkeypatch.setattr(os, "fsync", fdatasync)

    def fail_at(self, later: int, cause: int = errno.EIO) -> None:
        self.fails_from, self.cause = self._syncs + later, cause


@pytest.fixture
def contents(tiny: SmallFiles) -> RecordContents:
    with open_bench(tiny.bench_files) as bench:
        plan = read_file(tiny.plan, PlanFile)
        abilities = BenchCapabilities.of(bench)
        shots = planned_shots(plan, abilities)
        patterns = {name: np.zeros(abilities.panel_shape, np.uint8) for name in plan.patterns}
        return build_record_contents(bench, plan, patterns, shots, abilities, lambda: None)


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Disk:
    return Disk(monkeypatch)


def run(files: SmallFiles, path: Path, **attendance):
    with open_bench(files.bench_files) as bench:
        return run_plan(bench, read_file(files.plan, PlanFile), path, Attendance(**attendance))


def test_complete_is_written_when_all_else_is_on_the_disk_and_told_when_it_is_there(
    tiny: SmallFiles, tmp_path: Path, disk: Disk
) -> None:
    outcome = run(tiny, tmp_path / "run.h5")
    assert outcome.state is State.COMPLETE
    assert outcome.digest
    last = disk.events.index("COMPLETE")
    before = disk.events[:last]
    # Between the sync and the state there are only message, time of the end and closing digest,
    # each twice.
    assert before[::-1].index("sync") <= 6
    assert "sync" in disk.events[last:]
    assert disk.events[::-1].index("sync") < disk.events[::-1].index("COMPLETE")


@pytest.mark.parametrize("cause", [errno.EIO, errno.ENOSPC, errno.EDQUOT])
def test_frames_that_the_disk_lost_are_named_and_taken_again(
    tiny: SmallFiles, tmp_path: Path, disk: Disk, cause: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(disk_sync, "EVERY", 0.001)
    path, taken = tmp_path / "run.h5", []

    def after_frame(shot, frame) -> None:
        taken.append(shot.index)
        if shot.index == 5:
            disk.fail_at(1, cause)

    outcome = run(tiny, path, on_frame=after_frame)
    assert outcome.state is State.FAILED
    assert "the disk didn't keep what was written: frames" in outcome.message
    assert outcome.digest
    monkeypatch.undo()
    with Record(path) as record:
        lost = record.frames_not_stored()
    assert {*range(len(taken), 16)} < {*lost}
    assert not verify(path).is_in_order
    with open_bench(tiny.bench_files) as bench:
        assert resume_run(bench, path).state is State.COMPLETE
    assert verify(path).is_in_order


@pytest.mark.parametrize("later", [1, 2])
def test_no_run_is_complete_whose_end_the_disk_refused(
    tiny: SmallFiles, tmp_path: Path, disk: Disk, later: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(disk_sync, "EVERY", 1e9)
    path = tmp_path / "run.h5"
    outcome = run(tiny, path, on_frame=lambda shot, _: shot.index or disk.fail_at(later))
    assert outcome.state is State.FAILED
    assert "isn't on the disk" in outcome.message
    with Record(path) as record:
        assert record.state is State.FAILED
    with open_bench(tiny.bench_files) as bench:
        assert resume_run(bench, path).state is State.COMPLETE


def test_a_file_is_on_the_disk_before_its_name_and_then_its_name(
    tmp_path: Path, disk: Disk, monkeypatch: pytest.MonkeyPatch
) -> None:
    link = os.link
    monkeypatch.setattr(os, "link", lambda *given: (disk.events.append("name"), link(*given)))
    write_atomically(tmp_path / "file", b"text")
    assert disk.events == ["sync", "name", "sync"]


REFUSED = 3
"""Of so many writes to the disk, one is refused; all of them in a sweep."""


@pytest.mark.parametrize(
    "part", [0, *(pytest.param(k, marks=pytest.mark.sweep) for k in range(1, REFUSED))]
)
def test_a_refused_write_of_any_part_of_the_draft_leaves_no_record(
    contents: RecordContents, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, part: int
) -> None:
    path, count, refused = tmp_path / "run.h5", [0], [0]
    write = os.pwrite

    def pwrite(handle: int, data: bytes, offset: int) -> int:
        count[0] += 1
        if count[0] == refused[0]:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return write(handle, data, offset)

    monkeypatch.setattr(os, "pwrite", pwrite)
    close_locked(create_record(path, contents))
    path.unlink()
    writes = count[0]
    assert writes > 20
    for number in range(1 + part, writes + 1, REFUSED):
        count[0], refused[0] = 0, number
        with pytest.raises(UserError, match="No space left"):
            create_record(path, contents)
        assert [*tmp_path.glob("*.h5*"), *tmp_path.glob(".*h5*")] == []


def content(path: Path) -> dict[str, tuple[list[tuple[str, str]], bytes]]:
    """Attributes and data of all in a record that is written before its first frame."""
    found = {}

    def collect(name: str, item: h5py.Group | h5py.Dataset) -> None:
        attributes = sorted((key, str(value)) for key, value in item.attrs.items())
        data = item[()].tobytes() if isinstance(item, h5py.Dataset) else b""
        changes = name in ("entry/digests/structure", "entry/copy")
        found[name] = attributes, b"" if changes else data

    with h5py.File(path) as file:
        collect("", file)
        file.visititems(collect)
    return found


SWALLOWED = 20
"""Of so many writes to the draft, one is tried; all of them in a sweep."""


@pytest.mark.parametrize(
    "part", [0, *(pytest.param(k, marks=pytest.mark.sweep) for k in range(1, SWALLOWED))]
)
def test_a_swallowed_write_of_the_draft_leaves_no_record_or_a_whole_one(
    contents: RecordContents, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, part: int
) -> None:
    """What wasn't written may have been zeros, or have been written again later."""
    path, count, swallowed, refused = tmp_path / "run.h5", [0], [0], 0
    write = DraftFile.write

    def forgetful(self: DraftFile, data: bytes) -> int:
        count[0] += 1
        if count[0] == swallowed[0]:
            self.seek(len(data), os.SEEK_CUR)
            return len(data)
        return write(self, data)

    monkeypatch.setattr(DraftFile, "write", forgetful)
    monkeypatch.setattr(creation, "utc_timestamp", lambda: "2026-01-02T03:04:05.678+00:00")
    close_locked(create_record(path, contents))
    good, writes = content(path), count[0]
    path.unlink()
    for number in range(1 + part, writes + 1, SWALLOWED):
        count[0], swallowed[0] = 0, number
        try:
            close_locked(create_record(path, contents))
        except UserError as error:
            refused += "doesn't read back" in str(error)
            assert not path.exists()
        else:
            assert content(path) == good
            path.unlink()
        assert [*tmp_path.glob("*.h5*"), *tmp_path.glob(".*h5*")] == []
    assert refused > 3


def test_frames_that_are_written_while_a_sync_fails_are_given_up_with_the_others(
    tmp_path: Path, disk: Disk, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The end of a run asks once more, and no frame is noted after the last one."""
    monkeypatch.setattr(disk_sync, "EVERY", 1e9)
    (tmp_path / "file").write_bytes(b"text")
    kept = disk_sync.DiskSync(str(tmp_path / "file"))
    kept.note_frame(3)
    monkeypatch.setattr(disk_sync, "sync_handle", lambda _: lose(kept))
    for _ in range(2):
        with pytest.raises(disk_sync.LostWrites) as lost:
            kept.flush()
    assert lost.value.frames == [3, 4]
    assert "frames 3-4 may be lost" in str(lost.value)
    kept.close()


def lose(kept: disk_sync.DiskSync) -> None:
    """A sync that fails while another frame is being written."""
    kept.note_frame(4)
    raise OSError(errno.EIO, os.strerror(errno.EIO))
