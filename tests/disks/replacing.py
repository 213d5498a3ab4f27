"""Whether a file that a command writes is the old or the new one, whole, after any power cut."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from disks.disk import Disk
from disks.trace import Event

Files = Mapping[str, bytes | None]
"""The files of a folder by path; None for folders."""


def spoiled_files(
    folder: Path, before: Files, events: Sequence[Event], after: Files, cuts: int, seed: int
) -> list[str]:
    """Names of files that some of the power cuts, drawn by a seed, left neither old nor new.

    Also of those that aren't new when the command has ended. Drafts don't count.
    """
    rng, disk, done = np.random.default_rng(seed), Disk(folder, before), 0
    found: list[str] = []
    for place in [*np.sort(rng.integers(0, len(events) + 1, cuts)).tolist(), len(events)]:
        disk.apply_all(events[done:place])
        done = place
        there = disk.draw(rng)
        for path in {*before, *after}:
            right = (
                {after.get(path)} if place == len(events) else {before.get(path), after.get(path)}
            )
            if not Path(path).name.startswith(".") and there.get(path) not in right:
                found.append(f"{Path(path).name} after {place} of {len(events)} calls")
    return found
