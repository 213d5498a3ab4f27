"""Cookies of X servers: a program without the cookie can neither read the screen nor draw on it.

The server reads its cookie from a file of its own, and programs find it in the user's authority
file, as after `xauth add`. The format and the lock of these files are those of libXau.
"""

from __future__ import annotations

import errno
import os
import secrets
import socket
import struct
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

_LOCAL, _ANY = 256, 65535
"""Families of addresses, FamilyLocal and FamilyWild of Xauth.h: this host, and every host."""

_NAME = b"MIT-MAGIC-COOKIE-1"

_COOKIE_BYTES = 16
"""Bytes of a cookie, as xauth's `generate` makes them."""

_LOCK_TIMEOUT = 5.0
"""Seconds for which another program may hold the lock of the authority file. Chosen."""

_LOCK_LIFE = 60.0
"""Seconds after which a lock is left over from a program that was killed; as in xauth."""


@dataclass(frozen=True)
class Entry:
    """An entry of an authority file: whom it is for, by address and display number, and the data.

    kind: name of the protocol.
    """

    family: int
    address: bytes
    number: bytes
    kind: bytes
    data: bytes

    def encode(self) -> bytes:
        """Return the entry of an X server as bytes, each text after its length."""
        texts = (self.address, self.number, self.kind, self.data)
        parts = [struct.pack(">H", len(text)) + text for text in texts]
        return struct.pack(">H", self.family) + b"".join(parts)


@contextmanager
def server_cookie(folder: Path) -> Iterator[tuple[Path, bytes]]:
    """Make a new cookie for an X server; yield the server's authority file, and the cookie.

    The file is in `folder`, and only this user may read it. It is removed at the end.
    """
    cookie = secrets.token_bytes(_COOKIE_BYTES)
    file = folder / f"labapp-{secrets.token_hex(8)}.xauth"
    handle = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
    try:
        with os.fdopen(handle, "wb") as written:
            written.write(Entry(_ANY, b"", b"", _NAME, cookie).encode())
        yield file, cookie
    finally:
        file.unlink(missing_ok=True)


@contextmanager
def published_cookie(display: str, cookie: bytes) -> Iterator[None]:
    """Let this user's programs find the cookie of an X server while the block lasts.

    The cookie is in the user's authority file, XAUTHORITY or ~/.Xauthority. display: such as ":99".
    Raises OSError if that file can't be written.
    """
    number = display.partition(":")[2].encode()
    entry = Entry(_LOCAL, socket.gethostname().encode(), number, _NAME, cookie)
    _change(remove_address_of=entry, add=entry)
    try:
        yield
    finally:
        with suppress(OSError):
            _change(remove=entry)


def authority_file() -> Path:
    """Return the authority file in which this user's programs look for cookies of X servers."""
    return Path(os.environ.get("XAUTHORITY") or Path.home() / ".Xauthority")


def read_entries(data: bytes) -> tuple[list[Entry], bytes]:
    """Return the entries of an authority file of X servers, and what can't be read as entries."""
    entries = []
    rest = memoryview(data)
    while len(rest) >= 2:
        (family,) = struct.unpack_from(">H", rest)
        texts, at = [], 2
        for _ in range(4):
            length = int.from_bytes(rest[at : at + 2], "big")
            texts.append(bytes(rest[at + 2 : at + 2 + length]))
            at += 2 + length
        if at > len(rest):
            break
        entries.append(Entry(family, *texts))
        rest = rest[at:]
    return entries, bytes(rest)


def _change(
    *, remove_address_of: Entry | None = None, remove: Entry | None = None, add: Entry | None = None
) -> None:
    """Change the user's authority file: remove an X server's entry, or all of its address, add one.

    Raises OSError if the file can't be written.
    """
    file = authority_file().resolve()
    with _hold_lock(file):
        found, rest = read_entries(file.read_bytes() if file.exists() else b"")
        kept = [
            entry
            for entry in found
            if entry != remove
            and not (remove_address_of and _address(entry) == _address(remove_address_of))
        ]
        if add is not None:
            kept.append(add)
        new = file.with_name(f"{file.name}-n")
        handle = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o600)
        with os.fdopen(handle, "wb") as written:
            written.write(b"".join(entry.encode() for entry in kept) + rest)
        new.replace(file)


def _address(entry: Entry) -> tuple[int, bytes, bytes]:
    """Return whom an entry of an X server's cookie is for."""
    return entry.family, entry.address, entry.number


@contextmanager
def _hold_lock(file: Path) -> Iterator[None]:
    """Hold the lock of an authority file of X servers, as xauth does, or raise OSError."""
    made, lock = (file.with_name(f"{file.name}-{end}") for end in "cl")
    late = time.monotonic() + _LOCK_TIMEOUT
    while not _take(made, lock):
        if time.monotonic() > late:
            raise OSError(errno.EAGAIN, "is locked by another program", str(file))
        time.sleep(0.05)
    try:
        yield
    finally:
        for one in (made, lock):
            one.unlink(missing_ok=True)


def _take(made: Path, lock: Path) -> bool:
    """Try to take the lock of an authority file of X servers; return whether that succeeded."""
    with suppress(FileNotFoundError):
        if time.time() - made.stat().st_ctime > _LOCK_LIFE:
            for one in (made, lock):
                one.unlink(missing_ok=True)
    try:
        os.close(os.open(made, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600))
    except FileExistsError:
        return False
    # libXau links the file that it has made, for file systems that don't know O_EXCL.
    os.link(made, lock)
    return True
