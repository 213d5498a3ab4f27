"""That the same seed gives the same data, and that a killed run keeps its frames."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from labapp.acquisition.state import State
from labapp.figures import Figure
from labapp.record.reader import Record

_ACKNOWLEDGED = 17
"""Frames after which the run is killed: in the middle of the demo's plan."""


def same_seed(folder: Path) -> list[Figure]:
    """Two runs of the demo's plan, array by array."""
    from labapp.figures.acknowledging import run_bundled

    records = [folder / "first.h5", folder / "second.h5"]
    for path in records:
        run_bundled(path)
    differing = differing_arrays(*records)
    measured = "all equal" if not differing else f"{', '.join(differing)} differ"
    return [
        Figure(
            "arrays of two runs with the same seed", "equal bit for bit", measured, not differing
        )
    ]


def differing_arrays(first: Path, second: Path) -> list[str]:
    """Names of the arrays that aren't the same in two records, bit for bit."""
    with Record(first) as a, Record(second) as b:
        left, right = a.arrays(), b.arrays()
    names = left.keys() | right.keys()
    return sorted(name for name in names if not _same(left.get(name), right.get(name)))


def _same(a: NDArray[Any] | None, b: NDArray[Any] | None) -> bool:
    """Bit for bit, so that NaN equals itself; texts by their letters."""
    if a is None or b is None or a.dtype != b.dtype or a.shape != b.shape:
        return False
    return a.tolist() == b.tolist() if a.dtype.hasobject else a.tobytes() == b.tobytes()


def after_a_kill(folder: Path) -> list[Figure]:
    """A run killed with SIGKILL: does the file open, and is every acknowledged frame there?"""
    path = folder / "killed.h5"
    acknowledged = kill_after(path, _ACKNOWLEDGED)
    with Record(path) as record:
        lost = sorted(set(acknowledged) & set(record.missing()))
        state = record.state
    kept = len(acknowledged) - len(lost)
    return [
        Figure(
            "after one kill -9",
            "file opens, acknowledged frames are there",
            f"{state}, {kept} of {len(acknowledged)} acknowledged frames read back",
            not lost and state is State.INTERRUPTED,
        )
    ]


def kill_after(path: Path, frames: int) -> list[int]:
    """Run the bundled plan in a process, kill it after some frames; those it acknowledged."""
    command = [sys.executable, "-m", "labapp.figures.acknowledging", str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        acknowledged = [int(process.stdout.readline()) for _ in range(frames)]
        process.send_signal(signal.SIGKILL)
        acknowledged += [int(line) for line in process.stdout.read().split()]
    return acknowledged
