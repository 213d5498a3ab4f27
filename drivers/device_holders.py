"""Which other processes of this computer have a device open, and how to name them."""

from __future__ import annotations

import os
import pwd
import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

_COMMAND_WORDS = 3
"""Words of a command that are told of a process. Chosen."""

_LEFT_BEHIND = re.compile(r"drivers\.hosted\.\w+:\w+")
"""A word in the command of each process that `drivers.hosted` has started: what it does."""

_PROCESSES = Path("/proc")


def device_holders(path: str) -> list[int]:
    """Return the other processes that have a device file open, as far as this user may see them.

    Root sees all, and others their own and whoever has locked the file (flock(2)). The far end of
    a pseudo-terminal isn't meant: it is the device.
    """
    try:
        device = os.stat(path).st_rdev
    except OSError:
        return []
    found = {process for process in _processes() if _has_open(process, device)}
    found |= set(_lock_holders(path))
    return sorted(found - {os.getpid()})


def name_holders(path: str) -> str:
    """Return who else has a device file open, in words; empty if nobody is known to."""
    return " and ".join(map(name_process, device_holders(path)))


def name_process(process: int) -> str:
    """Name a process by its command and number, and its user if that's another."""
    try:
        user = Path(_PROCESSES, str(process)).stat().st_uid
    except OSError:
        return "another program"
    of_user = "" if user == os.getuid() else f" of {name_user(user)}"
    return f"{_command(process)} (process {process}{of_user})"


def name_user(user: int) -> str:
    """Return the name of a user by number."""
    try:
        return pwd.getpwuid(user).pw_name
    except KeyError:
        return f"user {user}"


def udp_socket_holder(port: int) -> str:
    """Return who has a UDP port of this computer open, in words; empty if nobody has.

    A GigE camera tells the port of the program that controls it.
    """
    for line in _lines("/proc/net/udp")[1:]:
        words = line.split()
        if int(words[1].rpartition(":")[2], 16) == port:
            for process in _processes():
                if f"socket:[{words[9]}]" in _open_files(process).values():
                    return name_process(process)
            return f"a program of {name_user(int(words[7]))}"
    return ""


def _processes() -> Iterator[int]:
    """Yield the numbers of this computer's processes."""
    yield from (int(name) for name in os.listdir(_PROCESSES) if name.isdigit())


def _open_files(process: int) -> dict[str, str]:
    """Return what a process has open, by descriptor; nothing if this user may not know."""
    folder, found = _PROCESSES / str(process) / "fd", {}
    with suppress(OSError):
        for number in os.listdir(folder):
            with suppress(OSError):
                found[number] = os.readlink(folder / number)
    return found


def _has_open(process: int, device: int) -> bool:
    """Return whether a process has a device open, and isn't itself the device."""
    files, folder = _open_files(process), _PROCESSES / str(process)
    here = False
    for number, name in files.items():
        if name.startswith("/dev/"):
            with suppress(OSError):
                here = here or (folder / "fd" / number).stat().st_rdev == device
    if not here:
        return False
    far = [number for number, name in files.items() if name.endswith("/ptmx")]
    return not any(_is_far_end(folder / "fdinfo" / number, device) for number in far)


def _is_far_end(told: Path, device: int) -> bool:
    """Return whether the master of a pseudo-terminal may be that of a device.

    told: what the system tells of it, which is its number but on an old Linux.
    """
    numbers = [line.split()[-1] for line in _lines(told) if line.startswith("tty-index:")]
    return not numbers or int(numbers[0]) == os.minor(device)


def _lock_holders(path: str) -> Iterator[int]:
    """Yield the processes that have locked a device file, of whichever user."""
    with suppress(OSError):
        file = os.stat(path)
        where = f"{os.major(file.st_dev):02x}:{os.minor(file.st_dev):02x}:{file.st_ino}"
        for line in _lines("/proc/locks"):
            words = line.replace("->", "").split()
            # A process of another container has the number 0 or -1.
            if words[1] == "FLOCK" and words[5] == where and int(words[4]) > 0:
                yield int(words[4])


def _lines(path: str | Path) -> list[str]:
    try:
        return Path(path).read_text().splitlines()
    except OSError:
        return []


def _command(process: int) -> str:
    """Return a process's command, in words.

    The window's engine and other processes of labapp are children of the one that was called.
    """
    for number in (process, _parent(process)):
        words = _words(number)
        names = [Path(word).name for word in words]
        if "labapp" in names:
            start = names.index("labapp")
            return " ".join(["labapp", *words[start + 1 : start + _COMMAND_WORDS]])
    words = _words(process)
    if any(_LEFT_BEHIND.fullmatch(word) for word in words):
        return "a process of a labapp that was killed, which makes it safe and ends by itself"
    python = bool(words) and Path(words[0]).name.startswith("python")
    if python and len(words) > 1 and not words[1].startswith("-"):
        return words[1]
    return Path(words[0]).name if words else "another program"


def _words(process: int) -> list[str]:
    """Return the words of a process's command, printable; none if it is gone or hidden."""
    try:
        told = (_PROCESSES / str(process) / "cmdline").read_bytes().decode(errors="replace")
    except OSError:
        return []
    return ["".join(c if c.isprintable() else "?" for c in word) for word in told.split("\0")[:-1]]


def _parent(process: int) -> int:
    """Return the number of a process's parent; 0 if it can't be told."""
    told = _lines(_PROCESSES / str(process) / "stat")
    return int(told[0].rpartition(")")[2].split()[1]) if told else 0
