"""Records on file systems that keep no locks, know no second names, or can't be synchronised."""

from __future__ import annotations

import errno
import fcntl
import os
import subprocess
import sys
from types import SimpleNamespace

import h5py
import pytest
from plans import block, plan_of

from labapp.bench.opening import open_bench
from labapp.common.errors import UserError
from labapp.files import write_locks
from labapp.files.plain_hdf5 import open_hdf5
from labapp.files.write_locks import close_locked, duplicate_locked, is_locked, open_locked
from labapp.files.writing import write_atomically
from labapp.runs.acquisition.attendance import Attendance
from labapp.runs.acquisition.frame_storage import require_space
from labapp.runs.acquisition.runner import resume_run, run_plan
from labapp.runs.export import export_frames
from labapp.runs.record.checks import check_record
from labapp.runs.record.reader import Record
from labapp.runs.state import State

PLAN = plan_of(block(targets=["dark"], repeats=2))

RIVAL = """
import errno, fcntl, sys
from pathlib import Path
def refuse(*given): raise OSError(errno.ENOLCK, "No locks available")
fcntl.fcntl = refuse
from labapp.common.errors import UserError
from labapp.files.write_locks import open_locked
try:
    open_locked(Path(sys.argv[1]))
    print("taken")
except UserError as error:
    print(error)
"""


def refuse(monkeypatch, module, name, code):
    def refusing(*given, **more):
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(module, name, refusing)


@pytest.fixture
def no_locks(monkeypatch):
    """As glibc and HDF5 tell it on a share without a lock daemon."""

    def opening(path, mode="r", *, locking=None, **more):
        if locking is not False:
            raise OSError(
                errno.ENOLCK,
                "Unable to synchronously open file (unable to lock file, errno = 37, error message "
                "= 'No locks available')",
            )
        return plain(path, mode, locking=locking, **more)

    plain = h5py.File
    refuse(monkeypatch, fcntl, "fcntl", errno.ENOLCK)
    monkeypatch.setattr(h5py, "File", opening)


@pytest.fixture
def bench(small):
    with open_bench(small.bench_files) as opened:
        yield opened


@pytest.mark.parametrize("code", [errno.EINVAL, errno.EOPNOTSUPP])
def test_a_record_is_written_read_and_resumed_without_locks_links_and_fsync(
    bench, tmp_path, no_locks, monkeypatch, code, caplog
):
    refuse(monkeypatch, os, "link", code)
    refuse(monkeypatch, os, "fdatasync", code)
    path = tmp_path / "run.h5"

    def intrude(shot, frame):
        assert is_locked(path)
        for write in (
            lambda: run_plan(bench, PLAN, path, force=True),
            lambda: resume_run(bench, path),
            lambda: write_atomically(path, b"something else"),
        ):
            with pytest.raises(UserError, match=rf"is being written by process {os.getpid()} on "):
                write()

    assert run_plan(bench, PLAN, path, Attendance(on_frame=intrude)).state is State.COMPLETE
    assert "keeps no locks" in caplog.text
    assert "doesn't tell when data are on the disk" in caplog.text
    assert not is_locked(path)
    assert check_record(path).is_in_order
    with Record(path) as record:
        assert any("keeps no locks" in line for _, line in record.log)
    assert export_frames(path, "npy", tmp_path / "out").frames == [0, 1]
    assert resume_run(bench, path).state is State.COMPLETE
    assert run_plan(bench, PLAN, path, force=True).state is State.COMPLETE
    assert not write_locks._named_locks


def test_another_process_is_kept_out_without_locks_and_told_by_whom(tmp_path, no_locks):
    path = tmp_path / "file"
    path.touch()
    first = open_locked(path)
    second = duplicate_locked(first)
    for handle in (first, second):
        said = subprocess.run(
            [sys.executable, "-c", RIVAL, path], capture_output=True, text=True, check=True
        ).stdout
        assert f"is being written by process {os.getpid()}" in said
        close_locked(handle)
    assert not is_locked(path)
    close_locked(open_locked(path))


def test_a_move_that_fails_leaves_no_empty_file(tmp_path, monkeypatch):
    """And the error is that of the move, whatever the file system said of links."""
    refuse(monkeypatch, os, "link", errno.EINVAL)
    refuse(monkeypatch, os, "replace", errno.EIO)
    with pytest.raises(OSError, match=os.strerror(errno.EIO)):
        write_atomically(tmp_path / "file", b"data")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("code", [errno.EIO, errno.EACCES, errno.ESTALE, errno.EAGAIN])
def test_an_error_of_the_system_is_named_and_nothing_else_guessed(
    bench, tmp_path, monkeypatch, code
):
    path = tmp_path / "run.h5"
    run_plan(bench, PLAN, path)
    refuse(monkeypatch, h5py, "File", code)
    told = "another program has locked it" if code == errno.EAGAIN else os.strerror(code)
    with pytest.raises(UserError, match=told) as caught:
        Record(path)
    assert "HDF5" not in str(caught.value)
    with pytest.raises(OSError, match=os.strerror(code)):
        open_hdf5(path)


def test_a_disk_that_tells_no_size_is_not_taken_for_a_full_one(tmp_path, monkeypatch):
    told = os.statvfs(tmp_path)
    nothing = SimpleNamespace(f_bavail=0, f_frsize=told.f_frsize, f_blocks=0)
    monkeypatch.setattr(os, "statvfs", lambda path: nothing)
    require_space(tmp_path / "run.h5", 1 << 40)
    refuse(monkeypatch, os, "statvfs", errno.ENOSYS)
    require_space(tmp_path / "run.h5", 1 << 40)
    full = SimpleNamespace(f_bavail=0, f_frsize=told.f_frsize, f_blocks=told.f_blocks)
    monkeypatch.setattr(os, "statvfs", lambda path: full)
    with pytest.raises(UserError, match="has 0 MB free"):
        require_space(tmp_path / "run.h5", 1 << 40)
