"""Reading of bytes from outside: regular files only, and no more than fits in memory.

A path may lead to a pipe on which nobody writes, to a device without end, or to a few kilobytes
that stand for gigabytes. Every reader of labapp opens files through this module, which finds out
before it reads.
"""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path

from labapp.common.errors import UserError
from labapp.common.plain_text import shorten

MOST_BYTES = 1 << 32
"""Bytes of a file of pictures or numbers, 4 GiB: the cubes of published collections have up to
2 GB. Chosen."""

MOST_TEXT_BYTES = 16 << 20
"""Bytes of a table as text, 16 MiB: a million wavelengths of a spectrum. Chosen."""

FREE_EXPANSION = 1 << 26
"""Bytes that holes in a file, and texts and MATLAB's arrays, may stand for whatever is stored of
them, 64 MiB. Chosen."""

_FREE_ARRAYS = 200_000_000
"""Bytes that compressed arrays may stand for whatever their size: a star on black in 48 million
pixels of single precision, which is stored in some kilobytes, takes 192 MB. Chosen."""

MOST_PIXELS = 300_000_000
"""Pixels that a picture may have however small its file is: twice those of the largest sensors of
cameras, 151 million. Chosen."""

MOST_EXPANSION = 100
"""Bytes that a byte of compressed data may stand for beyond that. Photographs have up to 30, masks
about 100; deflate ends at 1030 (RFC 1951), which only data without content reaches. Chosen."""

_ALWAYS_FREE = 1 << 20
"""Bytes of data for which the free memory isn't looked up. Chosen."""

_FREE_SHARE = 0.8
"""Share of the free memory that the data of a file may take; the rest is for what is made of them.
Chosen."""

_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a named pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)
"""What a path may lead to besides a regular file, by the test of its mode."""


@contextmanager
def open_regular(path: Path, most: int = MOST_BYTES) -> Iterator[BufferedReader]:
    """Open a regular file of at most `most` bytes for reading; a context manager.

    Raises UserError if there is no such file, it may not be read, it is a folder, pipe, socket or
    device, which aren't opened, it is too large, or reading fails within the block.
    """
    try:
        # Opening a pipe or a device can itself act on it, so that the path is looked at before.
        _require_regular(path, os.stat(path).st_mode)
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)
        with os.fdopen(handle, "rb") as file:
            found = os.fstat(handle)
            _require_regular(path, found.st_mode)
            _require_size(path, found.st_size, most)
            yield file
    except OSError as error:
        raise unreadable(path, error) from error
    except ValueError as error:
        if "\0" not in str(path):
            raise
        raise UserError(f"{str(path)!r}: is no path: it has a NUL. Check the path.") from error


def require_regular(path: Path, most: int = MOST_BYTES) -> None:
    """Raise UserError unless a path leads to a regular file that can be read."""
    with open_regular(path, most):
        pass


def read_bytes(path: Path, most: int = MOST_BYTES) -> bytes:
    """Return all bytes of a regular file; raise UserError if it can't be read or is too large."""
    with open_regular(path, most) as file:
        found = os.fstat(file.fileno())
        require_no_holes(path, found)
        require_free_memory(path, found.st_size)
        data = file.read(found.st_size + 1)
        if len(data) > found.st_size:
            # Files of /proc and others that are made when they are read tell a size of 0.
            data += file.read(max(most - found.st_size, 0))
        _require_size(path, len(data), most)
        return data


def require_memory(
    path: Path, stored: int, whole: int, what: str = "its contents", *, pixels: int | None = None
) -> None:
    """Raise UserError if stored data stand for much more than is stored, or than there is memory.

    stored, whole: bytes of the data in the file, and in memory when they are expanded.
    pixels: of a picture. A dark one may be stored in next to nothing, and is refused only if no
    sensor has so many; other data, where they grow without measure.
    """
    is_large = whole > _FREE_ARRAYS if pixels is None else pixels > MOST_PIXELS
    if is_large and whole > MOST_EXPANSION * stored:
        raise _hollow(path, whole, stored, what)
    require_free_memory(path, whole, what)


def require_free_memory(path: Path, whole: int, what: str = "its contents") -> None:
    """Raise UserError if `whole` bytes of data would take more memory than there is."""
    # Nobody asks about a few megabytes: finding out costs more than it saves.
    if whole <= _ALWAYS_FREE:
        return
    from labapp.common.free_memory import available_memory

    if whole > _FREE_SHARE * (free := available_memory()):
        raise UserError(
            f"{path}: {what} would take {_size(whole)} of memory, and {_size(free)} are free. "
            "Close other programs, give a part of it, or use a computer with more memory."
        )


def require_no_holes(path: Path, found: os.stat_result) -> None:
    """Raise UserError if a file is nearly all holes, which read as zeros."""
    # Some file systems don't tell the blocks.
    stored = 512 * found.st_blocks
    if stored and found.st_size > max(FREE_EXPANSION, MOST_EXPANSION * stored):
        raise _hollow(path, found.st_size, stored, "its contents")


def is_file(path: Path) -> bool:
    """Return whether a path leads to a regular file; impossible paths don't."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def unreadable(path: Path, error: OSError) -> UserError:
    """Return the error that says why a path can't be read."""
    if error.errno == errno.ENOENT:
        return UserError(f"{path}: cannot be read: there is no such file. Check the path.")
    if error.errno == errno.ENAMETOOLONG:
        return UserError(f"{shorten(str(path), 100)}: is no path: it is too long. Check the path.")
    return UserError(f"{path}: cannot be read: {error.strerror or error}. Check the path.")


def _require_regular(path: Path, mode: int) -> None:
    """Raise UserError if a path leads to something else than a regular file."""
    kind = next((name for test, name in _KINDS if test(mode)), "")
    if kind:
        raise UserError(f"{path}: cannot be read: it is {kind}. Give a regular file.")


def _require_size(path: Path, size: int, most: int) -> None:
    """Raise UserError if there are more bytes than such files have."""
    if size > most:
        raise UserError(
            f"{path}: has {_size(size)}, and such a file has at most {_size(most)}. Give another "
            "file."
        )


def _hollow(path: Path, whole: int, stored: int, what: str) -> UserError:
    """Return the error of data that stand for much more bytes than are stored."""
    return UserError(
        f"{path}: {what} would take {_size(whole)}, and {_size(stored)} are stored. No "
        "measurement is so empty; get the original, or save it without compression."
    )


def _size(count: int) -> str:
    """Format a number of bytes, as in 3.5 MB."""
    for unit, scale in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= scale:
            return f"{count / scale:.3g} {unit}"
    return f"{count} bytes"
