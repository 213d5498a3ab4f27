"""Locks on files that are being written, past which new files are moved to their paths.

A lock belongs to the open file, not to the process. The operating system releases it when the file
is closed, however the process ends. Where a file system keeps no locks, a named lock of the user
takes its place, which other users and other computers don't see.
"""

from __future__ import annotations

import errno
import fcntl
import glob
import os
import secrets
import socket
import stat
import struct
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from labapp.common.errors import UserError

if TYPE_CHECKING:
    from labapp.common.named_locks import NamedLock

_LOCK = struct.pack("hhqqi4x", fcntl.F_WRLCK, os.SEEK_SET, 2**62, 1, 0)
"""The lock for writing, as fcntl(2) takes it.

It covers one byte far beyond the file's end, so that it doesn't interfere with HDF5's own locks.
"""

_PATIENCE = 0.5
"""Seconds after which a lock that nobody is known to hold counts as held. Chosen."""

_PAUSE = 0.01
"""Seconds between two looks at a lock. Chosen: longer than a file takes to be moved."""

NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL, errno.ENOTTY)
"""Errors of file systems that keep no locks, such as some network shares."""

_named_locks: dict[int, NamedLock] = {}
"""Named locks of this process, by the handles of the open files that they stand for."""


def lock_file(handle: int) -> bool:
    """Lock an open file for writing; return whether that succeeded. close_locked() releases it."""
    try:
        fcntl.fcntl(handle, fcntl.F_OFD_SETLK, _LOCK)
    except OSError as error:
        if error.errno not in NO_LOCKS:
            if error.errno not in (errno.EAGAIN, errno.EACCES):
                raise
            return False
        # Most file systems keep locks, and a run loads no more than it needs.
        from labapp.common.named_locks import take_named_lock

        lock = take_named_lock(_lock_name(os.fstat(handle)))
        if lock is None:
            return False
        _named_locks[handle] = lock
    return True


def _named_lock_holder(file: os.stat_result) -> int | None:
    """Return the process that holds the named lock, 0 if unknown; None if nobody does."""
    from labapp.common.named_locks import find_lock_holder

    return find_lock_holder(_lock_name(file))


def _lock_name(file: os.stat_result) -> str:
    return f"labapp-file-{file.st_dev:x}-{file.st_ino:x}"


def close_locked(handle: int) -> None:
    """Close a handle, and with the last one release the lock."""
    os.close(handle)
    if (lock := _named_locks.pop(handle, None)) is not None:
        lock.close()


def duplicate_locked(handle: int) -> int:
    """Return another handle of an open file; its lock is released with the last of them."""
    found = os.dup(handle)
    if (lock := _named_locks.get(handle)) is not None:
        _named_locks[found] = lock.share()
    return found


def lock_limit(handle: int) -> str:
    """Return what the lock of a handle can't promise, in words; empty if it is a whole one."""
    if handle not in _named_locks:
        return ""
    return (
        "the file system keeps no locks. Your other processes on this computer can't write the "
        "file meanwhile; don't write it as another user or from another computer"
    )


def open_locked(path: Path) -> int:
    """Open a path for writing; return its handle, which holds the lock until it's closed.

    The handle is of the file that has the path once the lock is held. Raises UserError if another
    process writes the file, or it isn't a plain file, and OSError if it can't be opened.
    """
    while True:
        handle = os.open(path, os.O_RDWR | os.O_CLOEXEC | os.O_NONBLOCK)
        try:
            if not stat.S_ISREG(os.fstat(handle).st_mode):
                raise UserError(f"{path}: isn't a plain file. Choose another name.")
            # Before the lock was held, another process may have put a new file there.
            if lock_file(handle) and has_path(handle, path):
                found, handle = handle, -1
                return found
        finally:
            if handle >= 0:
                close_locked(handle)
        require_unlocked(path)


def require_unlocked(path: Path) -> None:
    """Raise UserError if another process writes to a path; the message says which."""
    give_up = time.monotonic() + _PATIENCE
    while is_locked(path):
        # Who moves a file holds the lock for a moment; then nobody is found who has it.
        holder = _lock_holder(path)
        if holder is not None or time.monotonic() > give_up:
            who = f"process {holder} on {socket.gethostname()}"
            if holder is None:
                who = "another user's process or one on another host (labapp verify says which)"
            raise UserError(
                f"{path}: is being written by {who}. Wait for it to end, or choose another name."
            )
        time.sleep(_PAUSE)


def is_locked(path: Path) -> bool:
    """Return whether a process writes to a path, such as a run to its record."""
    try:
        handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    except OSError:
        return False
    try:
        # This asks for the lock without taking it.
        found = fcntl.fcntl(handle, fcntl.F_OFD_GETLK, _LOCK)
    except OSError:
        return _named_lock_holder(os.fstat(handle)) is not None
    finally:
        os.close(handle)
    return struct.unpack_from("h", found)[0] != fcntl.F_UNLCK


def has_path(handle: int, path: Path) -> bool:
    """Return whether an open file is still the one that a path names."""
    with suppress(FileNotFoundError):
        return os.path.samestat(os.fstat(handle), path.stat())
    return False


def is_deleted(handle: int) -> bool:
    """Return whether an open file was deleted, or another was put in its place."""
    return os.fstat(handle).st_nlink == 0


def move_into_place(draft: Path, path: Path, *, force: bool) -> None:
    """Move a complete draft to its path, but never onto a file that a run writes.

    Without `force`, no file is replaced at all. Raises UserError if another file is in the way.
    """
    while not _move_to_free_path(draft, path):
        if not force:
            raise UserError(f"{path}: exists already. Choose another name, or add --force.")
        if path.is_symlink() and not path.exists():
            os.replace(draft, path)
            return
        with suppress(FileNotFoundError):
            # While its lock is held, nobody begins to write the file that goes away.
            old = open_locked(path)
            try:
                os.replace(draft, path)
            finally:
                close_locked(old)
            return


def _move_to_free_path(draft: Path, path: Path) -> bool:
    """Move a draft to a free path; return False if the path is taken."""
    try:
        os.link(draft, path)
    except FileExistsError:
        return False
    except OSError:
        # Whatever the file system says of second names: if the path can't be written, opening the
        # placeholder tells the cause.
        return _move_onto_placeholder(draft, path)
    # The file is in its place, whether or not its other name goes away.
    with suppress(OSError):
        os.unlink(draft)
    return True


def _move_onto_placeholder(draft: Path, path: Path) -> bool:
    """Move a draft to a free path where the file system knows no second names."""
    try:
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC)
    except FileExistsError:
        return False
    try:
        # Somebody may have replaced the empty file already.
        if not lock_file(handle) or not has_path(handle, path):
            return False
        try:
            os.replace(draft, path)
        except OSError:
            os.unlink(path)
            raise
    finally:
        close_locked(handle)
    return True


def name_draft(path: Path) -> Path:
    """Return a new temporary name for what this process writes to a path.

    In a folder of several users, none can take it beforehand, because it can't be guessed. Drafts
    that killed processes left behind are removed.
    """
    for draft in path.parent.glob(f".{glob.escape(path.name)}.*.new"):
        pid = draft.name.removesuffix(".new").rpartition(".")[2]
        # A process on another host may write it; then it has the lock.
        if pid.isdigit() and not Path("/proc", pid).exists() and not is_locked(draft):
            with suppress(OSError):
                draft.unlink()
    return path.with_name(f".{path.name}.{secrets.token_hex(4)}.{os.getpid()}.new")


def _lock_holder(path: Path) -> int | None:
    """Return the process of this user that holds a path's lock; None if it can't be found."""
    with suppress(OSError):
        if holder := _named_lock_holder(path.stat()):
            return holder
    for process in Path("/proc").iterdir():
        # Processes end meanwhile, and those of other users tell nothing.
        with suppress(OSError):
            if process.name.isdigit() and _holds_lock(process, path.stat()):
                return int(process.name)
    return None


def _holds_lock(process: Path, file: os.stat_result) -> bool:
    """Return whether a process, by its folder in /proc, holds the lock."""
    for opened in (process / "fd").iterdir():
        with suppress(OSError):
            if not os.path.samestat(opened.stat(), file):
                continue
            if "OFDLCK" in (process / "fdinfo" / opened.name).read_text():
                return True
    return False
