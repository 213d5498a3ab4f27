"""Syncs that fail once, at any moment of a run: what the disk lost then must be told."""

from __future__ import annotations

import pickle
import re
import shutil
from dataclasses import dataclass
from pathlib import Path

import forked
import numpy as np
from disks.disk import Disk, put, snapshot
from disks.trace import Event
from small_bench.files import SmallFiles, write_tiny

from figures import Figure
from figures.cut_runs import AROUND, PROGRAM
from figures.fault_cases import word_of_fault
from figures.power_cuts import Cut, End, kept_frames, mend
from labapp.common.console import print_message

_MOMENTS = 50

_EVERY = (0.02, 0.1, 1e9)
"""Seconds between two syncs: many while a run goes on, few, and none but those of its end."""


@dataclass
class Loss:
    """What a failed sync has done. lost: frames that were told as stored, and aren't kept. untold:
    those of them that the run didn't name."""

    acknowledged: int
    lost: set[int]
    untold: set[int]
    failed: bool
    false_end: str = ""
    trouble: str = ""


def failed_syncs(folder: Path) -> list[Figure]:
    """Runs in which one sync fails, and loses what was written since the one before."""
    rng = np.random.default_rng(57)
    files = write_tiny(folder / "bench")
    found = [fail_one(files, folder / "run", rng) for _ in range(_MOMENTS)]
    untold = sum(len(one.untold) for one in found)
    told = sum(one.acknowledged for one in found)
    lost = sum(len(one.lost) for one in found)
    false = [one.false_end for one in found if one.false_end]
    troubles = [one.trouble for one in found if one.trouble]
    failed = sum(one.failed for one in found)
    first = f"; first: {troubles[0]}" if troubles else ""
    return [
        Figure(
            f"a sync that fails at {_MOMENTS} moments: frames that are lost untold",
            "0",
            f"{untold} of {told}; {lost} lost and named, {failed} syncs failed",
            told > 0 and not untold,
        ),
        Figure(
            "the same: COMPLETE, or saved, told of a record that isn't whole",
            "0",
            f"{len(false)}{f'; first: {false[0]}' if false else ''}",
            not false,
        ),
        Figure(
            "the same: records that no command mends, or commands that end in a traceback",
            "0",
            f"{len(troubles)} of {len(found)}{first}",
            not troubles,
        ),
    ]


def fail_one(files: SmallFiles, folder: Path, rng: np.random.Generator) -> Loss:
    """One run in which a sync fails, drawn by chance; then the system forgets what it lost."""
    every = float(rng.choice(_EVERY))
    number = int(rng.integers(1, {0.02: 25, 0.1: 11}.get(every, 5)))
    fails = f"{number} {rng.choice(['EIO', 'ENOSPC'])}"
    end = f"SIGINT {rng.integers(1, 15)}" if rng.random() < 0.3 else ""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    disk = Disk(folder, snapshot(folder))
    events, said, status = _run(files, folder, {"EVERY": str(every), "FAILS": fails, "END": end})
    disk.apply_all(events)
    record = folder / "run.h5"
    if not record.exists():
        troubled = not status or bool(word_of_fault(said))
        return Loss(0, set(), set(), True, trouble=said[-300:] if troubled else "")
    if bytes(disk.file(record).seen) != record.read_bytes():
        raise AssertionError("the record was written in a way that isn't seen")
    told = {int(one) for event in events for one in re.findall(rb"frame (\d+)\n", event.data)}
    whole = End.of(record)
    cut = folder.with_name("cut")
    shutil.rmtree(cut, ignore_errors=True)
    put(disk.draw(rng, written=bool(rng.random() < 0.8)), folder, cut)
    return _judge(cut / "run.h5", told, whole, said, any(_is_failure(one) for one in events))


def _run(files: SmallFiles, folder: Path, options: dict[str, str]) -> tuple[list[Event], str, int]:
    recorded = folder / "events"
    done = forked.run(
        [*PROGRAM, "run", files.plan, *files.arguments(), "--out", folder / "run.h5",
         "--speed", "0.7"],
        env=AROUND | {name: value for name, value in options.items() if value}
        | {"RECORD": str(recorded)},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    events = pickle.loads(recorded.read_bytes())
    recorded.unlink()
    return events, done.stdout + done.stderr, done.returncode


def _is_failure(event: Event) -> bool:
    return event.kind == "end" and not event.size


def _judge(record: Path, told: set[int], whole: End, said: str, failed: bool) -> Loss:
    after, complete = Cut(0), re.search(r"COMPLETE.*\ndigest (\w+)\n", said)
    saved = mend(record, after) if record.exists() else None
    lost = told - (kept_frames(saved, whole) if saved else set())
    found = Loss(len(told), lost, lost - _named(said), failed, trouble=after.trouble)
    if complete and (after.steps or not saved):
        found.false_end = said[-200:]
    if word_of_fault(said):
        found.trouble = said[-300:]
    if lost:
        print_message(f"  {len(lost)} frames lost, {len(found.untold)} untold")
    return found


def _named(said: str) -> set[int]:
    """The frames that a run names as lost, such as "frames 3-5, 7 may be lost"."""
    named: set[int] = set()
    for words in re.findall(r"frames ([\d, and-]+) may be lost", said.replace("\n", " ")):
        for first, last in re.findall(r"(\d+)(?:-(\d+))?", words):
            named |= set(range(int(first), int(last or first) + 1))
    return named


MEASUREMENTS = {"failed syncs": failed_syncs}
