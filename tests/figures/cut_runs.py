"""Runs of a small plan, and all that they change in a folder, to be cut by a model of the disk."""

from __future__ import annotations

import os
import re
import sys
from dataclasses import dataclass
from pathlib import Path

import forked
import numpy as np
from disks.disk import Disk, snapshot
from disks.trace import Event, trace
from small_bench.files import SmallFiles, write_tiny

from figures.where import PACKAGES

_WALL = 6.0
"""Seconds that a run takes, so that most of its frames are older than those stated."""


AROUND = os.environ | {"PYTHONPATH": PACKAGES, "OMP_NUM_THREADS": "1"}
PROGRAM = (sys.executable, "-m", "disks.telling")


@dataclass(frozen=True)
class Traced:
    """A command that wrote a record, and all that it changed in the record's folder.

    before: the folder's files. acknowledged: frames that were stored before.
    """

    folder: Path
    before: dict[str, bytes | None]
    events: list[Event]
    acknowledged: frozenset[int] = frozenset()
    said: str = ""

    @property
    def record(self) -> Path:
        return self.folder / "run.h5"

    def disk_before(self) -> Disk:
        return Disk(self.folder, self.before)


def command(*words: str | Path) -> tuple[int, str, str]:
    """A command of labapp: its exit status, and what it said on both ways."""
    python = [*PROGRAM, *map(str, words)]
    around = AROUND | {"CHECKS": "here"}
    done = forked.run(python, env=around, capture_output=True, text=True, check=False)
    return done.returncode, re.sub(r"^(frame \d+\n)+", "", done.stdout), done.stderr


def trace_runs(folder: Path, rng: np.random.Generator) -> list[Traced]:
    """New runs, one that replaces a record, one that is ended, and resumed ones."""
    files = write_tiny(folder / "bench")
    runs = [Runs(files, folder / f"{number}", rng) for number in range(6)]
    return [
        runs[0].run(),
        runs[1].run(),
        runs[2].run(over=True),
        runs[3].run(end=f"SIGINT {rng.integers(2, 30)}"),
        runs[4].resume(),
        runs[5].resume(),
    ]


class Runs:
    """Runs of a plan in a folder of their own, at a pace at which syncing matters."""

    def __init__(self, files: SmallFiles, folder: Path, rng: np.random.Generator) -> None:
        folder.mkdir()
        self._files, self._folder, self._rng = files, folder, rng
        repeats = int(rng.integers(2, 5))
        self._plan = files.folder / f"plan-{folder.name}.toml"
        self._plan.write_text(f"{files.plan.read_text()}repeats = {repeats}\n")
        self._pace = ["--speed", f"{0.55 * repeats / _WALL:.3f}"]
        self._run = [
            *("run", self._plan, *files.arguments()), "--out", folder / "run.h5", "--force",
        ]  # fmt: skip

    def run(self, *, end: str = "", over: bool = False) -> Traced:
        """A run of the plan; over: where another's record is already."""
        if over:
            command(*self._run)
        return self._trace(*self._run, *self._pace, end=end)

    def resume(self) -> Traced:
        """A run that was killed some time ago, and is resumed."""
        last = int(self._rng.integers(2, 20))
        ended = [*PROGRAM, *self._run, *self._pace]
        environment = AROUND | {"END": f"SIGKILL {last}"}
        forked.run(ended, env=environment, stdout=forked.DEVNULL)
        return self._trace("resume", self._folder / "run.h5", *self._pace, there=last + 1)

    def _trace(self, *words: str | Path, end: str = "", there: int = 0) -> Traced:
        before = snapshot(self._folder)
        events, done = trace(
            [*PROGRAM, *words],
            self._folder,
            environment=AROUND | ({"END": end} if end else {}),
        )
        said = done.stdout + done.stderr
        return Traced(self._folder, before, events, frozenset(range(there)), said)
