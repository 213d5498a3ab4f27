"""A disk that runs full at random moments, on a small file system in memory."""

from __future__ import annotations

import contextlib
import ctypes
import os
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from tempfile import mkdtemp

import forked
import numpy as np
from small_bench.setups import random_plan, small_setup

from drivers.interfaces import Frame
from figures import Figure
from figures.durability import differing_arrays, run_small
from figures.where import PACKAGES
from labapp.bench.opening import open_bench
from labapp.runs.acquisition import frame_storage
from labapp.runs.acquisition.attendance import Attendance
from labapp.runs.acquisition.runner import RunOutcome, run_plan
from labapp.runs.record.reader import Record
from labapp.runs.shots import Shot
from labapp.runs.state import State

_MOMENTS = 50
_DISK = "8m"
_PATIENCE = 60.0


def full_disk_figure(folder: Path) -> list[Figure]:
    """Runs whose disk is filled up and freed again, in a process with a disk of its own."""
    troubles, paused = fill_often(folder, _MOMENTS)
    name = "disk full at 50 random moments, then freed"
    goal = "no acknowledged frame wrong, paused, COMPLETE, arrays identical"
    if troubles is None:
        return [Figure(name, goal, "a file system can't be mounted here", None)]
    measured = f"{_MOMENTS - len(troubles)} of {_MOMENTS} right, {paused} pauses"
    if troubles:
        measured += f"; first trouble: {troubles[0]}"
    return [Figure(name, goal, measured, not troubles)]


def fill_often(folder: Path, moments: int, seed: int = 0) -> tuple[list[str] | None, int]:
    """What went wrong at so many moments, and how often runs paused; None if it can't be tried."""
    command = [sys.executable, "-m", "figures.full_disk", str(folder), str(moments), str(seed)]
    environment = os.environ | {"PYTHONPATH": PACKAGES}
    answer = forked.run(command, env=environment, stdout=forked.PIPE, text=True)
    if answer.returncode == _NO_MOUNT or not answer.stdout:
        return None, 0
    first, *troubles = answer.stdout.splitlines()
    if answer.returncode:
        troubles.append(f"it ended with {answer.returncode}")
    return troubles, int(first)


_NO_MOUNT = 3

_NEW_MOUNTS, _NEW_USER = 0x00020000, 0x10000000
"""Of unshare(2); from linux/sched.h."""


def _have_own_mounts() -> bool:
    """Give this process a name space of mounts, which vanish with it; False if it may not."""
    user, group = os.geteuid(), os.getegid()
    if ctypes.CDLL(None).unshare(_NEW_MOUNTS | (_NEW_USER if user else 0)):
        return False
    if user:
        for name, text in (
            ("setgroups", "deny"), ("uid_map", f"0 {user} 1"), ("gid_map", f"0 {group} 1"),
        ):  # fmt: skip
            Path("/proc/self", name).write_text(text)
    # What is mounted in it would be seen outside where mounts are shared.
    return not subprocess.run(["mount", "--make-rprivate", "/"], capture_output=True).returncode


def _main(folder: Path, moments: int, seed: int) -> int:
    if not _have_own_mounts():
        return _NO_MOUNT
    disk = Path(mkdtemp(dir=folder))
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={_DISK}", "tmpfs", str(disk)], capture_output=True
    )
    if mounted.returncode:
        return _NO_MOUNT
    found = Counter[str]()
    paused = 0
    for moment in range(moments):
        rng = np.random.default_rng([seed, moment])
        trouble, pauses = _fill_once(folder, disk, rng, watched=moment % 2 == 0)
        paused += pauses
        found.update([trouble] if trouble else [])
    print(paused)
    for trouble in found.elements():
        print(trouble)
    return 0


def _fill_once(
    folder: Path, disk: Path, rng: np.random.Generator, *, watched: bool
) -> tuple[str, int]:
    """What went wrong, and how often the run paused.

    watched: whether the run may see how full the disk is, or only hears it from a write.
    """
    plan = random_plan(rng)
    reference, path = folder / "whole.h5", disk / "run.h5"
    for file in (reference, path):
        file.unlink(missing_ok=True)
    run_small(plan, reference)
    with Record(reference) as whole:
        frames = whole.frame_count
    filler = _Filler(disk, path, reference, int(rng.integers(frames - 1)), rng.random() < 0.5)
    with open_bench(small_setup()) as bench, _blindfolded(not watched):
        outcome = run_plan(bench, plan, path, Attendance(on_frame=filler.after_frame))
    filler.join()
    return filler.trouble or _judge(outcome, reference, path), filler.pauses


@contextlib.contextmanager
def _blindfolded(blind: bool) -> Iterator[None]:
    """While the block runs, the disk seems to have room, as it does with a quota."""
    original = frame_storage.free_bytes
    if blind:
        frame_storage.free_bytes = lambda path: 1 << 40
    try:
        yield
    finally:
        frame_storage.free_bytes = original


class _Filler:
    """Fills the disk after a frame, at once or beside the run; looks at the file; frees it."""

    def __init__(self, disk: Path, path: Path, reference: Path, after: int, beside: bool) -> None:
        self._ballast, self._path, self._reference = disk / "ballast", path, reference
        self._after, self._beside = after, beside
        self._thread: threading.Thread | None = None
        self._told: list[int] = []
        self.trouble, self.pauses = "", 0

    def after_frame(self, shot: Shot, frame: Frame) -> None:
        self._told.append(shot.index)
        if shot.index != self._after:
            return
        if not self._beside:
            self._fill()
        self._thread = threading.Thread(target=self._haunt)
        self._thread.start()

    def join(self) -> None:
        if self._thread is not None:
            self._thread.join()

    def _haunt(self) -> None:
        if self._beside:
            self._fill()
        told = len(self._told)
        if self._wait_for_pause():
            self.pauses = 1
            self._look(self._told[:told])
        self._ballast.unlink()

    def _fill(self) -> None:
        """Write until there is no room for a byte more."""
        with self._ballast.open("wb", buffering=0) as file:
            size = 1 << 20
            while size:
                try:
                    file.write(bytes(size))
                except OSError:
                    size //= 2

    def _wait_for_pause(self) -> bool:
        """Whether the run paused; filled beside it, the disk may have come too late."""
        late = time.monotonic() + _PATIENCE
        while time.monotonic() < late:
            with Record(self._path) as record:
                state, message = record.state, record.message
            if state is State.PAUSED:
                if "is full" not in message:
                    self.trouble = f"it pauses with: {message}"
                return True
            if state is State.COMPLETE:
                return False
            time.sleep(0.01)
        self.trouble = f"it is {state} instead of PAUSED"
        return False

    def _look(self, told: list[int]) -> None:
        """What was acknowledged is there now, as a fresh handle reads it."""
        with Record(self._path) as record, Record(self._reference) as whole:
            missing = set(record.missing_frames())
            for index in told:
                if index in missing:
                    self.trouble = f"frame {index} was acknowledged and is lost"
                elif not np.array_equal(record.image(index), whole.image(index)):
                    self.trouble = f"frame {index} was acknowledged and is wrong"


def _judge(outcome: RunOutcome, reference: Path, path: Path) -> str:
    if outcome.state is not State.COMPLETE:
        return f"{outcome.state}: {outcome.message}"
    differing = differing_arrays(reference, path)
    return f"{', '.join(differing)} differ" if differing else ""


MEASUREMENTS = {"disk": full_disk_figure}


if __name__ == "__main__":
    sys.exit(_main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])))
