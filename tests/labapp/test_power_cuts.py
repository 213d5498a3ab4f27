"""Power cuts and failed syncs, by a model of the disk that is given the calls really made."""

from __future__ import annotations

import errno
import json
import os
import re
import sys
from pathlib import Path
from socket import gethostname

import h5py
import numpy as np
import pytest
from disks.disk import PAGE, SECTOR, Disk, put, snapshot
from disks.recording import Recorder
from disks.replacing import spoiled_files
from disks.trace import STRACE, Event, trace
from small_bench.files import SmallFiles
from sweeps import some

from labapp.bench.opening import open_bench
from labapp.common.errors import UserError
from labapp.files.plan_file import PlanFile
from labapp.files.reading import read_file
from labapp.runs import verifying
from labapp.runs.acquisition.attendance import Attendance
from labapp.runs.acquisition.runner import RunOutcome, resume_run, run_plan
from labapp.runs.record import disk_sync, writer_process
from labapp.runs.record.checks import check_record
from labapp.runs.salvaging import salvage
from labapp.runs.state import State
from optics.progress import Progress

RANDOM = np.random.default_rng


def write(path: str, data: bytes, place: int = 0) -> Event:
    return Event(0, "write", path, data=data, size=place)


def sync(path: str, number: int, *, succeeds: bool = True, call: str = "fdatasync") -> list[Event]:
    end = Event(0, "end", path, call, size=int(succeeds), number=number)
    return [Event(0, "begin", path, number=number), end]


def seen_after_cuts(disk: Disk, path: str, **how: bool) -> set[bytes | None]:
    return {disk.draw(RANDOM(seed), **how).get(path) for seed in range(200)}


def test_what_was_synchronised_survives_and_what_was_not_is_lost_kept_or_torn() -> None:
    disk, path = Disk(Path("/d"), {"/d": None, "/d/f": bytes(PAGE)}), "/d/f"
    disk.apply_all([write(path, b"a" * PAGE), *sync(path, 1), write(path, b"b" * PAGE)])
    found = seen_after_cuts(disk, path)
    assert {b"a" * PAGE, b"b" * PAGE} < found
    sectors = {one[at : at + SECTOR] for one in found for at in range(0, PAGE, SECTOR)}
    assert sectors == {b"a" * SECTOR, b"b" * SECTOR}
    disk.apply_all(sync(path, 2))
    assert seen_after_cuts(disk, path) == {b"b" * PAGE}


def test_pages_that_a_failed_sync_lost_come_back_only_by_being_written_again() -> None:
    disk, path = Disk(Path("/d"), {"/d": None, "/d/f": bytes(2 * PAGE)}), "/d/f"
    disk.apply_all([write(path, b"a" * 2 * PAGE), *sync(path, 1, succeeds=False), *sync(path, 2)])
    assert bytes(2 * PAGE) in seen_after_cuts(disk, path, written=True)
    disk.apply_all([write(path, b"b"), *sync(path, 3)])
    first = {one[:PAGE] for one in seen_after_cuts(disk, path, written=True)}
    assert first == {b"b" + b"a" * (PAGE - 1)}


def test_a_name_is_sure_when_its_folder_was_synchronised_and_not_only_its_data() -> None:
    disk = Disk(Path("/d"), {"/d": None, "/d/f": b"old"})
    disk.apply_all([Event(0, "open", "/d/new"), write("/d/new", b"new"), *sync("/d/new", 1)])
    disk.apply_all([Event(0, "rename", "/d/new", "/d/f"), *sync("/d", 2)])
    assert seen_after_cuts(disk, "/d/f") == {b"old", b"new"}
    disk.apply_all(sync("/d", 3, call="fsync"))
    assert seen_after_cuts(disk, "/d/f") == {b"new"}


@pytest.mark.skipif(STRACE is None, reason="strace isn't here")
def test_a_file_that_is_replaced_is_the_old_or_the_new_one_after_any_cut(tmp_path: Path) -> None:
    folder = tmp_path / "results"
    folder.mkdir()
    (folder / "old").write_bytes(b"old" * 3000)
    program = (
        "from pathlib import Path\n"
        "from labapp.files.writing import make_folder, write_atomically\n"
        "from labapp.runs.export.atomic_files import all_or_none\n"
        f"folder = Path({str(folder)!r})\n"
        "write_atomically(folder / 'old', b'new' * 3000)\n"
        "make_folder(folder / 'deep' / 'deeper')\n"
        "write_atomically(folder / 'deep' / 'deeper' / 'file', b'file')\n"
        "with all_or_none(folder / 'out', lambda: iter('ab'), force=False) as draft:\n"
        "    for name in 'ab': (draft / name).write_bytes(b'exported' * 3000)\n"
    )
    before = snapshot(folder)
    events, done = trace([sys.executable, "-c", program], folder, environment=dict(os.environ))
    assert done.returncode == 0, done.stderr
    after = snapshot(folder)
    assert after[str(folder / "out" / "b")] == b"exported" * 3000
    assert spoiled_files(folder, before, events, after, 300, 1) == []


def run(files: SmallFiles, path: Path, **attendance) -> RunOutcome:
    with open_bench(files.bench_files) as bench:
        return run_plan(bench, read_file(files.plan, PlanFile), path, Attendance(**attendance))


@pytest.mark.parametrize("seed", some(range(12)))
def test_a_cut_takes_no_frame_that_was_synchronised_and_resume_takes_the_others(
    tiny: SmallFiles, tmp_path: Path, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(disk_sync, "EVERY", 0.02)
    # After a cut, the process that wrote is gone.
    monkeypatch.setattr(writer_process, "is_alive", lambda _: False)
    monkeypatch.setattr(verifying, "verify", lambda path, _=None: check_record(path))
    folder, rng = tmp_path / "before", RANDOM(seed)
    folder.mkdir()
    disk = Disk(folder, snapshot(folder))
    with Recorder(folder) as recorder:
        run(tiny, folder / "run.h5", on_frame=lambda shot, _: recorder.tell(f"{shot.index} "))
    events = recorder.events
    first = next(n for n, one in enumerate(events) if one.kind == "told")
    for number, place in enumerate(np.sort(rng.integers(first, len(events) + 1, 3)).tolist()):
        disk = Disk(folder, {str(folder): None})
        disk.apply_all(events[:place])
        path = tmp_path / f"cut-{number}" / "run.h5"
        put(disk.draw(rng), folder, path.parent)
        found = check_record(path)
        assert not {*synchronised(events[:place])} & {*found.not_stored, *found.damaged}
        if not found.is_in_order:
            assert found.resume_command
            with open_bench(tiny.bench_files) as bench:
                assert resume_run(bench, path).state is State.COMPLETE
    disk.apply_all(events[place:])
    assert bytes(disk.file(folder / "run.h5").seen) == (folder / "run.h5").read_bytes()
    assert disk.file(folder / "run.h5").is_on_disk


def synchronised(events: list[Event]) -> list[int]:
    """Frames that were told before the last sync began that has succeeded."""
    ended = {one.number for one in events if one.kind == "end" and one.size}
    begins = [n for n, one in enumerate(events) if one.kind == "begin" and one.number in ended]
    told = b"".join(one.data for one in events[: begins[-1]] if one.kind == "told")
    return [int(word) for word in told.split()]


def test_a_cancelled_run_whose_last_sync_fails_has_failed_and_names_the_frames(
    tiny: SmallFiles, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(disk_sync, "EVERY", 1e9)
    progress = Progress()
    with Recorder(tmp_path, fails=3, error=errno.EIO):
        outcome = run(
            tiny,
            tmp_path / "run.h5",
            progress=progress,
            on_frame=lambda shot, _: shot.index == 5 and progress.cancel(),
        )
    assert outcome.state is State.FAILED
    assert re.search(r"cancelled by the user.*frames 0-5 may be lost", outcome.message)
    assert outcome.missing == [*range(16)]


def test_frames_are_not_saved_where_the_disk_does_not_keep_them(
    tiny: SmallFiles, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(disk_sync, "EVERY", 1e9)
    run(tiny, tmp_path / "run.h5")
    with (
        Recorder(tmp_path, fails=3, error=errno.EIO),
        pytest.raises(UserError, match="didn't keep what was written: frames 0-15 may be lost"),
    ):
        salvage(tmp_path / "run.h5", tmp_path / "saved.h5")


@pytest.mark.parametrize(
    ("name", "left"), some([("state", b"RUNNIPLETE"), ("writer", b'{"h'), ("log", b"")], 0, 1, 2)
)
def test_resume_mends_what_a_cut_tore_beside_the_frames(
    tiny: SmallFiles, tmp_path: Path, name: str, left: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(verifying, "verify", lambda path, _=None: check_record(path))
    path, progress = tmp_path / "run.h5", Progress()
    run(tiny, path, progress=progress, on_frame=lambda shot, _: progress.cancel())
    with h5py.File(path, "r+") as file:
        file["entry/state"][0] = b"RUNNING"
        file["entry/writer"][0] = json.dumps({"host": gethostname(), "pid": 1 << 22, "start": "1"})
        file["entry/digests/closing"][0] = 0
        lines = [bytes(text) for text in file["entry/log"]["text"] if text]
        if name == "log":
            file["entry/log"][1] = np.zeros((), file["entry/log"].dtype)
        else:
            file[f"entry/{name}"][0] = left
    assert not check_record(path).is_in_order
    with open_bench(tiny.bench_files) as bench:
        assert resume_run(bench, path).state is State.COMPLETE
    assert check_record(path).is_in_order
    with h5py.File(path) as file:
        now = [bytes(text) for text in file["entry/log"]["text"] if text]
    assert {*now} >= {line for number, line in enumerate(lines) if number != 1 or name != "log"}
    assert (b"were lost from here on" in b" ".join(now)) == (name == "log")
