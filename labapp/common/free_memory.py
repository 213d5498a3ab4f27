"""How much memory the process may still take, by what machine, container and limits say."""

from __future__ import annotations

import os
import resource
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

_GROUPS = Path("/sys/fs/cgroup")
"""Where Linux keeps the limits of groups of processes, as containers have them."""

_NEW_NAMES = ("memory.max", "memory.current", "inactive_file")
_OLD_NAMES = ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")
"""Files of a group's limit and of what it uses, and the line of memory.stat that tells what files
take which are kept in memory; of cgroup v2 and v1 (kernel.org, "Memory Resource Controller")."""

_LIMITS = (
    (resource.RLIMIT_AS, "VmSize", "ulimit -v"),
    (resource.RLIMIT_DATA, "VmData", "ulimit -d"),
)
"""Limits of a process, the line of its status that tells how much of each it takes, and the shell's
words that set it."""

_MOST_ADDRESSES = 1 << 63


def available_memory() -> int:
    """Return the bytes that the process can still take without swapping or being killed.

    It is the least of what the machine has free (files that are kept in memory count as free), what
    the container leaves, and what a limit of the process leaves.
    """
    return min(shared_memory(), *(one.left for one in process_limits()), _MOST_ADDRESSES)


def shared_memory() -> int:
    """Return the bytes that machine and container still leave to this process and others."""
    return max(min(_machine_memory(), *_group_memory(), _MOST_ADDRESSES), 0)


def _machine_memory() -> int:
    """Return the bytes that the machine can give to programs."""
    told = _fields(Path("/proc/meminfo"))
    if "MemAvailable" in told:
        return told["MemAvailable"]
    # Other systems than Linux only tell what they have.
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def _group_memory() -> Iterator[int]:
    """Yield the bytes that each group of processes around this one leaves, where it has a limit."""
    try:
        lines = Path("/proc/self/cgroup").read_text().splitlines()
    except OSError:
        return
    for line in lines:
        _, kinds, own = line.split(":", 2)
        if kinds in ("", "memory"):
            root = _GROUPS / kinds
            folders = [root, *(root / own[1:]).parents, root / own[1:]]
            inside = [one for one in folders if one.is_relative_to(root)]
            yield from _room_in_groups(inside, _OLD_NAMES if kinds else _NEW_NAMES)


def _room_in_groups(folders: Iterable[Path], names: tuple[str, str, str]) -> Iterator[int]:
    """Yield the bytes that groups of processes leave, by their folders and the files' names."""
    limit, usage, kept = names
    for folder in folders:
        try:
            most, used = (int((folder / name).read_text()) for name in (limit, usage))
        # There is no such file at the root, and the word "max" where there is no limit.
        except (OSError, ValueError):
            continue
        # Files that are kept in memory count as used, and give way.
        yield most - used + _words(folder / "memory.stat").get(kept, 0)


class ProcessLimit(NamedTuple):
    """A limit of this process: its bytes, those that are left of it, and what sets it."""

    most: int
    left: int
    setting: str


def process_limits() -> Iterator[ProcessLimit]:
    """Yield the limits of the process' addresses and data, as far as it has any."""
    told = _fields(Path("/proc/self/status"))
    for kind, used, setting in _LIMITS:
        most = resource.getrlimit(kind)[0]
        if most != resource.RLIM_INFINITY:
            yield ProcessLimit(most, max(most - told.get(used, 0), 0), setting)


def _fields(path: Path) -> dict[str, int]:
    """Return the amounts in bytes of a file of the system, with lines such as "Name: 12 kB"."""
    return {name.rstrip(":"): 1024 * number for name, number in _words(path).items()}


def _words(path: Path) -> dict[str, int]:
    """Return the numbers of a file of the system, by the first word of their line."""
    try:
        lines = [line.split() for line in path.read_text().splitlines()]
    except OSError:
        return {}
    return {one[0]: int(one[1]) for one in lines if len(one) > 1 and one[1].isdigit()}
