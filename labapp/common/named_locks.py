"""Locks of one user's processes, by name: each is held until its holder closes it or ends.

A lock is that of an empty file, flock(2), in a folder that only the user may enter. So no other
user can hold a lock, keep it, or take its name, whatever they do; and no other user is kept out by
it. What keeps them out is the device's own lock, which only those have who have the device open.
"""

from __future__ import annotations

import errno
import fcntl
import os
import pwd
import socket
import stat
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

_PRIVATE = 0o700
"""Mode of a folder that only its owner may enter."""

_HELD = (errno.EAGAIN, errno.EACCES)
"""Errors of a lock that another process holds."""


class NamedLock:
    """A lock by name that this process holds, until it was closed as often as it was shared.

    handles: open files that have the lock, by their paths.
    """

    def __init__(self, handles: dict[Path, int]) -> None:
        self._handles, self._holders = handles, 1

    @property
    def is_held(self) -> bool:
        """Whether there was a folder for the lock, so that it keeps other processes out."""
        return bool(self._handles)

    def share(self) -> NamedLock:
        """Return the lock for somebody else of this process, who closes it, too."""
        self._holders += 1
        return self

    def close(self) -> None:
        """Release the lock if nobody else of this process shares it."""
        self._holders -= 1
        while not self._holders and self._handles:
            path, handle = self._handles.popitem()
            # The file goes while the lock is held; whoever waits for it looks whether it's there.
            with suppress(OSError):
                path.unlink()
            os.close(handle)


def take_named_lock(name: str) -> NamedLock | None:
    """Take this user's lock of a name; None if another process, or this one, holds it."""
    lock = NamedLock(taken := {})
    for folder in _folders():
        path = folder / _file_name(name)
        try:
            taken[path] = _take(path)
        except OSError as error:
            if error.errno in _HELD:
                lock.close()
                return None
            # Its file system is full, keeps no locks, or can't be written.
    return lock


def find_lock_holder(name: str) -> int | None:
    """Return this user's process that holds the lock of a name, or None; 0 if it can't be told."""
    for folder in _folders():
        with suppress(FileNotFoundError), open(folder / _file_name(name), "rb") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except OSError as error:
                if error.errno in _HELD:
                    told = file.read(20)
                    return int(told) if told.isdigit() else 0
    return None


def _take(path: Path) -> int:
    """Take the lock of a file, which is made; return its handle, or raise OSError."""
    while True:
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            # Who had the lock before may have removed the file meanwhile.
            with suppress(FileNotFoundError):
                if os.path.samestat(os.fstat(handle), path.lstat()):
                    os.ftruncate(handle, 0)
                    os.pwrite(handle, str(os.getpid()).encode(), 0)
                    found, handle = handle, -1
                    return found
        finally:
            if handle >= 0:
                os.close(handle)


def _file_name(name: str) -> str:
    # Several computers may share the home folder.
    return f"{socket.gethostname()}-{name}"


def _folders() -> Iterator[Path]:
    """Yield this user's folders of locks: that of the login, if there is one, and that at home.

    Environment variables don't choose them, because all processes of the user must agree.
    """
    user = os.geteuid()
    places = [Path(f"/run/user/{user}")]
    with suppress(KeyError):
        places.append(Path(pwd.getpwuid(user).pw_dir, ".local", "state"))
    for place in places:
        folder = place / "labapp" / "locks"
        with suppress(OSError):
            if place.parts[1] != "run" or place.is_dir():
                folder.mkdir(_PRIVATE, parents=True, exist_ok=True)
                if _is_private(folder, user):
                    yield folder


def _is_private(folder: Path, user: int) -> bool:
    """Return whether a folder of locks is the user's, and closed to others once this returns."""
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != user:
        return False
    if stat.S_IMODE(found.st_mode) != _PRIVATE:
        folder.chmod(_PRIVATE)
    return True
