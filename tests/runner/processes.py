"""The processes below a process: who they are, what memory they take, and their end."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Collection, Iterator
from contextlib import suppress
from pathlib import Path


def descendants(process: int) -> Iterator[int]:
    """The children of a process, and theirs."""
    try:
        tasks = list(Path(f"/proc/{process}/task").iterdir())
        children = [child for task in tasks for child in (task / "children").read_text().split()]
    except OSError:
        return  # it has ended
    for child in map(int, children):
        yield child
        yield from descendants(child)


def end_descendants(process: int, spared: Collection[int] = ()) -> None:
    """Kill what is below a process, but for some of its children with all that's below them."""
    late = time.monotonic() + 10
    while time.monotonic() < late:
        kept = {one for child in spared for one in (child, *descendants(child))}
        doomed = [one for one in descendants(process) if one not in kept and _is_alive(one)]
        if not doomed:
            return
        for one in doomed:
            with suppress(ProcessLookupError):
                os.kill(one, signal.SIGKILL)
        time.sleep(0.02)


def _is_alive(process: int) -> bool:
    """Whether it runs; one whose parent hasn't asked for its status yet doesn't."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False


class HighestMemory:
    """The most that a process and all below it hold, as often as somebody looks.

    What several share is counted once, which takes the system a good part of what tests take. So
    it's counted only where they hold more of their own than ever before, which is known at once.
    """

    def __init__(self, process: int) -> None:
        self._process, self._own = process, 0
        self.seen = 0
        """Bytes."""

    def look(self) -> None:
        processes = [self._process, *descendants(self._process)]
        own = sum(map(_own_memory, processes))
        if own > self._own:
            self._own = own
            self.seen = max(self.seen, sum(map(_proportional_share, processes)))


def _own_memory(process: int) -> int:
    """Bytes that no file and no other process holds, about."""
    try:
        _, resident, shared, *_ = Path(f"/proc/{process}/statm").read_text().split()
    except OSError:
        return 0  # it has ended
    return (int(resident) - int(shared)) * os.sysconf("SC_PAGE_SIZE")


def _proportional_share(process: int) -> int:
    try:
        lines = Path(f"/proc/{process}/smaps_rollup").read_text().splitlines()
    except OSError:
        return 0  # it has ended
    return sum(int(line.split()[1]) * 1024 for line in lines if line.startswith("Pss:"))
