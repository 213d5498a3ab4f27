"""Power cuts at any moment of a run, by the model of a disk in tests/disks."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np
from disks.disk import Disk, put
from disks.trace import STRACE

from figures import Figure
from figures.cut_runs import Traced, command, trace_runs
from figures.fault_cases import word_of_fault
from labapp.common.console import print_message

_CUTS = 300

STATED = 2.0
"""Seconds of frames that a power cut may take, as the guide says."""

_NONE = "strace isn't here"


@dataclass
class Cut:
    """What a power cut left. must: frames that it mustn't take. lost: those that it took.

    trouble: commands that ended in a way that no user should see. steps: what was done.
    """

    must: int
    lost: list[int] = field(default_factory=list)
    complete: bool = False
    spoiled: str = ""
    trouble: str = ""
    steps: list[str] = field(default_factory=list)


def power_cuts(folder: Path) -> list[Figure]:
    """Runs, resumed ones and salvaged ones, each cut at moments that are drawn by a seed."""
    if STRACE is None:
        return [Figure("300 power cuts: acknowledged frames lost", "0", _NONE, None)]
    rng = np.random.default_rng(56)
    traced = trace_runs(folder, rng)
    cuts = [cut for one in traced for cut in cut_often(one, _CUTS // len(traced), rng)]
    return [*_figures(cuts), _early_figure(traced)]


def _figures(cuts: Sequence[Cut]) -> list[Figure]:
    lost, must = sum(len(one.lost) for one in cuts), sum(one.must for one in cuts)
    complete = [one for one in cuts if one.complete]
    spoiled = [one.spoiled for one in complete if one.spoiled]
    troubles = [one.trouble for one in cuts if one.trouble]
    steps = [step for one in cuts for step in one.steps]
    ways = ", ".join(f"{steps.count(name)} {name}" for name in ("resume", "salvage"))
    first = f"; first: {(spoiled or troubles or [''])[0]}" if spoiled or troubles else ""
    return [
        Figure(
            f"{len(cuts)} power cuts: frames lost that were acknowledged more than {STATED:g} s "
            "before",
            "0",
            f"{lost} of {must} ({ways})",
            must > 0 and not lost,
        ),
        Figure(
            "power cuts after COMPLETE was told: records not wholly kept",
            "0",
            f"{len(spoiled)} of {len(complete)}{first if spoiled else ''}",
            bool(complete) and not spoiled,
        ),
        Figure(
            "power cuts: records that no command mends, or commands that end in a traceback",
            "0",
            f"{len(troubles)} of {len(cuts)}{first if troubles else ''}",
            not troubles,
        ),
    ]


def _early_figure(traced: Sequence[Traced]) -> Figure:
    early = [words for one in traced for words in told_early(one)]
    return Figure(
        "COMPLETE, digests and frames saved that are told before they are on the disk",
        "0",
        f"{len(early)} of {len(traced)} commands{f'; first: {early[0]}' if early else ''}",
        not early,
    )


def told_early(one: Traced) -> list[str]:
    """What a command told as final while its record wasn't on the disk."""
    disk, early = one.disk_before(), []
    for event in one.events:
        final = event.kind == "told" and re.search(rb"digest|COMPLETE|frames saved", event.data)
        if final and not (disk.file(one.record).is_on_disk and disk.names_on_disk()):
            early.append(event.data.decode()[:60])
        disk.apply(event)
    return early


def cut_often(one: Traced, count: int, rng: np.random.Generator) -> list[Cut]:
    """Cuts of a traced command at moments by chance: by time, by calls, and about its end."""
    moments = np.array([event.moment for event in one.events])
    times = rng.uniform(moments[0], moments[-1] + 0.5, count // 3)
    # About half of the last third come when all was told.
    last = rng.integers(len(moments) - 20, len(moments) + 20, count - 2 * (count // 3))
    places = [
        *np.searchsorted(moments, times),
        *rng.integers(0, len(moments) + 1, count // 3),
        *np.minimum(last, len(moments)),
    ]
    end, disk, found, done = End.of(one.record), one.disk_before(), [], 0
    for place in sorted(map(int, places)):
        disk.apply_all(one.events[done:place])
        done = place
        found.append(_cut(one, place, disk, end, rng))
    print_message(f"  {len(found)} cuts of {one.said.strip().splitlines()[-1][:60]}")
    return found


@dataclass(frozen=True)
class End:
    """Images and times of the frames as a record has them."""

    images: np.ndarray
    timestamps: np.ndarray

    @staticmethod
    def of(record: Path) -> End:
        with h5py.File(record, locking=False) as file:
            return End(file["entry/data/images"][()], file["entry/data/timestamp"][()])


def _cut(one: Traced, place: int, disk: Disk, end: End, rng: np.random.Generator) -> Cut:
    moment = one.events[place].moment if place < len(one.events) else one.events[-1].moment
    told = [event for event in one.events[:place] if event.kind == "told"]
    words = b"".join(event.data for event in told).decode()
    older = b"".join(event.data for event in told if event.moment < moment - STATED).decode()
    must = one.acknowledged | {int(frame) for frame in re.findall(r"frame (\d+)\n", older)}
    complete = re.search(r"COMPLETE.*\ndigest (\w+)\n", words)
    if complete:
        must = frozenset(range(len(end.timestamps)))
    folder = one.folder.with_name("cut")
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    put(disk.draw(rng), one.folder, folder)
    found = Cut(len(must), complete=bool(complete))
    record = folder / "run.h5"
    if not record.exists():
        found.lost = sorted(must)
        found.spoiled = "no file" if complete else ""
        return found
    if complete:
        status, _, said = command("verify", record, "--digest", complete[1])
        found.spoiled = "" if status == 0 else said
    saved = mend(record, found)
    found.lost = sorted(must - kept_frames(saved, end)) if saved else sorted(must)
    return found


def kept_frames(record: Path, end: End) -> set[int]:
    """The frames that a record has as they were taken the first time."""
    found = End.of(record)
    same = (found.timestamps == end.timestamps) & (found.images == end.images).all(axis=(1, 2))
    return set(np.flatnonzero(same).tolist())


def mend(record: Path, found: Cut) -> Path | None:
    """Do with a record what labapp says; where it is whole then, if anywhere."""
    status, told, said = command("verify", record, "--json")
    if status not in (0, 1) or word_of_fault(said):
        found.trouble = f"verify: {said[-300:]}"
        return None
    data = json.loads(told)
    if data["is_well"]:
        return record
    if data["go_on"]:
        return record if _succeeds(found, "resume", record, "--yes") else None
    saved = record.with_name("saved.h5")
    if _succeeds(found, "salvage", record, "--out", saved):
        return saved if _succeeds(found, "resume", saved, "--yes") else None
    return None


def _succeeds(found: Cut, *words: str | Path) -> bool:
    found.steps.append(str(words[0]))
    status, _, said = command(*words)
    if status:
        found.trouble = f"{words[0]}: {said[-300:]}"
    return status == 0


MEASUREMENTS = {"power cuts": power_cuts}
