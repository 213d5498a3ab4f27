"""X servers that this process starts, their cookies, and their inspection by xwd and xrandr."""

from __future__ import annotations

import errno
import os
import secrets
import select
import shutil
import socket
import struct
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.hosted.child_process import terminate_or_kill

_HEADER = struct.Struct(">25I")


def pixels_of(dump: bytes) -> NDArray[np.uint8]:
    """Return the pixels of an xwd screenshot of 24 bits: (rows, columns, 3) of blue, green, red."""
    header = _HEADER.unpack_from(dump)
    # Header fields: [0] its own size, [4] columns, [5] rows, [11] bits per pixel, [12] bytes per
    # line, and [19] entries of the colour map, of 12 bytes each.
    columns, rows, bits, line = header[4], header[5], header[11], header[12]
    begin = header[0] + 12 * header[19]
    # If the windows have several visuals, xwd packs pixels into 3 bytes and lines without padding,
    # whatever number of bytes per line the header gives.
    size = columns * bits // 8
    line = line if len(dump) - begin >= rows * line else size
    data = np.frombuffer(dump, np.uint8, rows * line, begin).reshape(rows, line)
    return data[:, :size].reshape(rows, columns, bits // 8)[..., :3]


# Families of addresses, FamilyLocal and FamilyWild of Xauth.h: this host, and every host.
_LOCAL, _ANY = 256, 65535

_NAME = b"MIT-MAGIC-COOKIE-1"

_COOKIE_BYTES = 16  # bytes of a cookie, as xauth's `generate` makes them

# Seconds for which another program may hold the lock of the authority file. Chosen.
_LOCK_TIMEOUT = 5.0

# Seconds after which a lock is left over from a program that was killed; as in xauth.
_LOCK_LIFE = 60.0


@dataclass(frozen=True)
class Entry:
    """Whom a cookie is for, by address and display number, and the cookie, in an authority file.

    kind: name of the protocol.
    """

    family: int
    address: bytes
    number: bytes
    kind: bytes
    data: bytes

    @property
    def whom(self) -> tuple[int, bytes, bytes]:
        """Return whom the entry is for."""
        return self.family, self.address, self.number

    def encode(self) -> bytes:
        """Return the entry as bytes, each text after its length."""
        texts = (self.address, self.number, self.kind, self.data)
        parts = [struct.pack(">H", len(text)) + text for text in texts]
        return struct.pack(">H", self.family) + b"".join(parts)


@contextmanager
def server_cookie(folder: Path) -> Iterator[tuple[Path, bytes]]:
    """Make a new cookie; yield the server's authority file, and the cookie.

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
    """Let this user's programs find a server's cookie while the block lasts.

    The cookie is in the user's authority file, XAUTHORITY or ~/.Xauthority. display: such as ":99".
    Raises OSError if that file can't be written.
    """
    number = display.partition(":")[2].encode()
    entry = Entry(_LOCAL, socket.gethostname().encode(), number, _NAME, cookie)
    _change(put=entry)
    try:
        yield
    finally:
        with suppress(OSError):
            _change(remove=entry)


def authority_file() -> Path:
    """Return the authority file in which this user's programs look for cookies."""
    return Path(os.environ.get("XAUTHORITY") or Path.home() / ".Xauthority")


def read_entries(data: bytes) -> tuple[list[Entry], bytes]:
    """Return an authority file's entries, and what can't be read as entries."""
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


def _change(*, remove: Entry | None = None, put: Entry | None = None) -> None:
    """Change the user's authority file: remove an entry, or put one in place of its address'.

    Raises OSError if the file can't be written.
    """
    file = authority_file().resolve()
    with _hold_lock(file):
        found, rest = read_entries(file.read_bytes() if file.exists() else b"")
        kept = [one for one in found if one != remove and not (put and one.whom == put.whom)]
        if put is not None:
            kept.append(put)
        new = file.with_name(f"{file.name}-n")
        handle = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o600)
        with os.fdopen(handle, "wb") as written:
            written.write(b"".join(entry.encode() for entry in kept) + rest)
        new.replace(file)


@contextmanager
def _hold_lock(file: Path) -> Iterator[None]:
    """Hold the lock of an authority file, as xauth does, or raise OSError."""
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
    """Try to take the lock of an authority file; return whether that succeeded."""
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


_MUTE: dict[str, Any] = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.DEVNULL)

# Seconds within which one of X's tools must answer, also on a busy computer. Chosen.
_TOOL_TIMEOUT = 60.0

# Seconds within which a server must be up, and a program must end; and most times that a server
# is started. Chosen.
_START_TIMEOUT, _START_TRIES = 30.0, 3


class NoXServer(OSError):
    """An X server can't be started; the message says why, and what helps."""


class XServer:
    """Run X's tools on the display of a running X server.

    Parameters
    ----------
    display : str
        The server's display, such as ":1".
    process : int
        The server's process id.
    """

    def __init__(self, display: str, process: int) -> None:
        self.display, self.process = display, process

    def run(self, *command: str, stdin: str = "") -> str:
        """Run an X tool on the display and return what it prints.

        Raises OSError if the tool isn't installed, and subprocess.SubprocessError if it fails.
        """
        return subprocess.run(
            command, input=stdin, env={**os.environ, "DISPLAY": self.display}, check=True,
            capture_output=True, text=True, timeout=_TOOL_TIMEOUT,
        ).stdout  # fmt: skip

    def xrandr(self, words: str) -> str:
        """Run xrandr with these arguments and return what it prints."""
        return self.run("xrandr", *words.split())

    def pixels(self) -> NDArray[np.uint8]:
        """Return all pixels as xwd reads them: (rows, columns, 3) of blue, green, red.

        Raises OSError if xwd isn't installed, or returns no picture.
        """
        command = ["xwd", "-display", self.display, "-root", "-silent"]
        late = time.monotonic() + _TOOL_TIMEOUT
        while time.monotonic() < late:
            done = subprocess.run(command, capture_output=True, timeout=_TOOL_TIMEOUT, check=False)
            if done.stdout:  # xwd fails if a window closes meanwhile: try again
                return pixels_of(done.stdout)
        raise OSError(f"xwd sees nothing on {self.display}: {done.stderr.decode()!r}")

    @contextmanager
    def program(self, *command: str) -> Iterator[subprocess.Popen[bytes]]:
        """Run a program on the display while the block lasts."""
        process = subprocess.Popen(command, env={**os.environ, "DISPLAY": self.display}, **_MUTE)
        try:
            yield process
        finally:
            terminate_or_kill(process, _START_TIMEOUT)


@contextmanager
def running_server(command: list[str]) -> Iterator[XServer]:
    """Run an X server on a free display while the block lasts.

    Only programs of this user can use it: they find its cookie in the user's authority file.

    Parameters
    ----------
    command : list of str
        The server's program and its arguments.

    Yields
    ------
    XServer
        The running server.

    Raises
    ------
    NoXServer
        If the server doesn't start.
    """
    with server_cookie(Path(tempfile.gettempdir())) as (file, cookie):
        server, number = _start_server([*command, "-auth", str(file)])
        with ExitStack() as stack:
            stack.callback(terminate_or_kill, server, _START_TIMEOUT)
            try:
                stack.enter_context(published_cookie(f":{number}", cookie))
            except OSError as error:
                raise NoXServer(
                    f"its cookie can't be kept in {authority_file()}: {error.strerror}. Let "
                    "XAUTHORITY name a file that you may write"
                ) from error
            yield XServer(f":{number}", server.pid)


def _start_server(command: list[str]) -> tuple[subprocess.Popen[bytes], str]:
    """Start an X server; return its process, and its display's number once it listens.

    A server that starts at the same moment may take the display that this one has found free, so
    that it ends; then it is tried again.
    """
    # setpriv lets the kernel end the server when this process, or the thread that starts the
    # block, ends.
    guard = ["setpriv", "--pdeathsig", "KILL", "--"] if shutil.which("setpriv") else []
    for _ in range(_START_TRIES):
        reading, writing = os.pipe()
        with os.fdopen(reading) as told:
            options = ["-displayfd", str(writing), "-nolisten", "tcp", "-noreset"]
            try:
                server = subprocess.Popen(
                    [*guard, *command, *options],
                    pass_fds=[writing],
                    # Ctrl-C must reach this process only, which ends the server last.
                    start_new_session=True,
                    **_MUTE,
                )
            finally:
                os.close(writing)
            number, ready = "", False
            try:
                # The server writes its display number, or ends without writing.
                ready = bool(select.select([told], [], [], _START_TIMEOUT)[0])
                number = told.readline().strip() if ready else ""
            finally:
                if not number:
                    terminate_or_kill(server, _START_TIMEOUT)
        if number:
            return server, number
        if not ready:
            break
    program = os.path.basename(command[0])
    raise NoXServer(f"{program} didn't start. Try it by hand: {program} -displayfd 1")


@contextmanager
def xvfb(columns: int, rows: int, display: str = "") -> Iterator[XServer]:
    """Run an X server with one invisible screen of 24 bits while the block lasts.

    Parameters
    ----------
    columns, rows : int
        Size of the screen in pixels.
    display : str, default ""
        The display, such as ":1"; a free one if empty.

    Yields
    ------
    XServer
        The running server.

    Raises
    ------
    NoXServer
        If Xvfb isn't installed or doesn't start.
    """
    program = require_program("Xvfb", "xvfb")
    number = [display] if display else []
    with running_server([program, *number, "-screen", "0", f"{columns}x{rows}x24"]) as server:
        yield server


def require_program(name: str, packages: str) -> str:
    """Return the path of an installed program.

    Parameters
    ----------
    name, packages : str
        The program's name, and the Debian packages that contain it, for the error message.

    Returns
    -------
    str
        The program's path.

    Raises
    ------
    NoXServer
        If the program isn't installed; the message names the packages.
    """
    found = shutil.which(name)
    if found is None:
        raise NoXServer(f"{name} isn't installed: sudo apt-get install {packages}")
    return found
