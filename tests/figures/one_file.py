"""That no frame is lost when two processes want the same file."""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np

from figures import Figure
from figures.rivals import WORKS, Deed, Rivals
from labapp.common.errors import UserError
from labapp.runs.export.export_job import TABLE
from labapp.runs.record.digests import image_digest
from labapp.runs.record.reader import Record
from labapp.runs.state import State

_SCHEDULES = 200

_LAST_FRAME = 5
"""Index of the last frame of a plan."""


@dataclass(frozen=True)
class Contest:
    """How a schedule ended. frames: acknowledged ones. lost: of those. wrong: in words."""

    works: tuple[str, ...]
    frames: int
    lost: int
    wrong: str


def two_processes(folder: Path) -> list[Figure]:
    """Two processes and one file, in 200 schedules."""
    found = contest(folder, _SCHEDULES)
    lost, frames = sum(one.lost for one in found), sum(one.frames for one in found)
    wrong = [one.wrong for one in found if one.wrong]
    measured = f"{lost} of {frames} frames lost, {len(wrong)} ends that weren't as they must be"
    if wrong:
        measured += f"; first: {wrong[0]}"
    return [
        Figure(
            f"two processes and one file, {_SCHEDULES} schedules of run, run --force, resume, "
            "export and other commands with --force",
            "0 frames lost, and who comes second is told who has the file",
            measured,
            not lost and not wrong,
        )
    ]


def contest(folder: Path, schedules: int, seed: int = 0) -> list[Contest]:
    """Random schedules of two processes that want one file."""
    with Rivals() as rivals:
        other = folder / "other.h5"
        rivals.take(work("run", "other", other, other, 0))
        return [_one(folder, other, rivals, [seed, number]) for number in range(schedules)]


def work(what: str, title: str, path: Path, other: Path, seed: Any, stop: int = -1) -> Any:
    return {
        "what": what, "title": title, "path": str(path), "other": str(other), "seed": seed,
        "stop": stop,
    }  # fmt: skip


def _one(folder: Path, other: Path, rivals: Rivals, seed: list[int]) -> Contest:
    rng = np.random.default_rng(seed)
    # An export may want the path, too.
    path = folder / TABLE
    path.unlink(missing_ok=True)
    deeds: list[Deed] = []
    if rng.random() < 0.6:
        stop = int(rng.integers(0, _LAST_FRAME))
        deeds += rivals.take(work("run", "before", path, other, [*seed, 2], stop))
    chosen = [str(name) for name in rng.choice(WORKS, 2)]
    # Who exports or resumes alone can lose nothing.
    if rng.random() < 0.8:
        chosen[0] = "run --force" if rng.random() < 0.6 else "run"
    works = []
    for number, (what, title) in enumerate(zip(chosen, ("left", "right"), strict=True)):
        stop = int(rng.integers(0, _LAST_FRAME)) if rng.random() < 0.2 else -1
        works.append(work(what, title, path, other, [*seed, number], stop))
    both = rivals.take(*works)
    lost, wrong = _judge(path, [*deeds, *both])
    frames = sum(len(deed.frames) for deed in (*deeds, *both))
    return Contest(tuple(chosen), frames, lost, wrong or _wrong_errors(both))


def _judge(path: Path, deeds: list[Deed]) -> tuple[int, str]:
    """How many acknowledged frames are gone, and what else is wrong.

    Those that a command with --force replaced after their run had ended aren't lost.
    """
    placed = max((deed.placed for deed in deeds), default=0.0)
    held, title, state = _held(path)
    lost, wrong = 0, ""
    for deed in deeds:
        kept = all(held.get(int(index)) == digest for index, digest in deed.frames.items())
        # A resumed run has the title of the one that began it.
        mine = title in (deed.title, "before") if deed.what == "resume" else title == deed.title
        if kept and mine:
            if deed.state == State.COMPLETE and state is not State.COMPLETE:
                wrong = f"{deed.what} said COMPLETE, and the record says {state}"
        elif deed.last >= placed:
            lost += len(deed.frames)
    for one, two in permutations(deeds, 2):
        if one.frames and one.first <= two.placed <= one.last:
            wrong = f"{two.what} replaced the file that {one.what} wrote"
    return lost, wrong


def _held(path: Path) -> tuple[dict[int, str], str, State | None]:
    """Digests of the frames in a file, the title of its run, and its state."""
    try:
        with Record(path) as record:
            missing = record.missing_frames()
            there = [index for index in range(record.frame_count) if index not in missing]
            digests = {index: image_digest(record.image(index)).hex() for index in there}
            return digests, record.text("title"), record.state
    except UserError:
        return {}, "", None


_WORDS = (
    r"is being written by process {process} on ",
    r"exists already",
    r"cancelled by the user",
    # Of what another command has written there.
    r"is not a record|can't be opened|is not an HDF5 file",
)


def _wrong_errors(both: list[Deed]) -> str:
    """What was said that must not be: anything but who has the file, or that one is there."""
    for deed, rival in zip(both, reversed(both), strict=True):
        words = [one.format(process=rival.process) for one in _WORDS]
        if deed.error and not any(re.search(one, deed.error) for one in words):
            return f"{deed.what}, with {rival.what}: {deed.error}"
        if deed.state not in ("", "written", State.COMPLETE, State.CANCELLED):
            return f"{deed.what}, with {rival.what}: {deed.state}"
    return ""


MEASUREMENTS = {"one file": two_processes}
