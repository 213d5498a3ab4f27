"""What another user of the computer can do to a bench, virtual or real, that this user has."""

from __future__ import annotations

import fcntl
import hashlib
import os
import signal
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import gettempdir

from drivers.errors import DeviceError
from drivers.x11 import XConnection
from figures import Figure
from figures.expected_time import served_bench
from labapp.bench.locking import device_names, lock_devices
from labapp.bench.opening import BenchFiles, open_device
from labapp.common.errors import UserError
from labapp.files.bench_file import BenchFile, DeviceTable
from labapp.files.reading import read_file

_NOBODY = 65534
"""Number of the user `nobody`, and of its group."""

_HOLDS = 600.0
"""Seconds for which the other user holds something at most."""

_NAME = (
    "another user: X pixels read or drawn, port opened, this user denied by locks and sockets, "
    "a port that they have open used beside them or not refused by their name"
)


def intrusions(folder: Path) -> list[Figure]:
    """What succeeds of all that another user tries, one after the other."""
    if os.geteuid() != 0:
        return [_figure("only root may become another user", None)]
    with served_bench(folder) as file:
        if file is None:
            return [_figure("the bench can't be served here", None)]
        tables = read_file(file, BenchFile).devices.tables
        open_files = {
            "the X server used": lambda: _use_screen(tables["slm"]),
            "the filter's port opened": lambda: _open_port(tables["filter"]),
        }
        # What this user can't do either tells nothing of others.
        assert all(_succeeds(attempt, os.getuid()) for attempt in open_files.values())
        tried = {
            **{name: _succeeds(attempt, _NOBODY) for name, attempt in open_files.items()},
            "denied by what they hold": _is_denied(tables),
            **{
                f"beside them, {words}": _is_beside(file, locked)
                for words, locked in (("locked", True), ("not locked", False))
            },
            "files left behind": _has_left_files(Path(gettempdir())),
        }
    done = [name for name, succeeded in tried.items() if succeeded]
    told = f"{len(done)} of {len(tried)} tries"
    return [_figure(f"{told}: {', '.join(done)}" if done else told, not done)]


def _figure(measured: str, met: bool | None) -> Figure:
    return Figure(_NAME, "0", measured, met)


def _use_screen(table: DeviceTable) -> None:
    """Connect: who is connected may read the screen and draw on it."""
    with XConnection(str(table.options["display"])):
        pass


def _open_port(table: DeviceTable) -> None:
    os.close(os.open(str(table.options["port"]), os.O_RDWR | os.O_NOCTTY))


def _is_denied(tables: dict[str, DeviceTable]) -> bool:
    """Whether this user can't have a device whose names another user holds in every way."""
    names = [name for table in tables.values() for name in device_names(table)]
    with _held_by_nobody(lambda: _hold_names(tables, names)):
        return not _is_free(tables)


def _hold_names(tables: dict[str, DeviceTable], names: list[str]) -> list[object]:
    """Hold a bench's devices by their locks, and by sockets and files of the names of old ones."""
    held: list[object] = [lock_devices(tables)]
    held[0].__enter__()  # type: ignore[attr-defined]
    for name in names:
        digest = hashlib.sha256(name.encode()).hexdigest()[:32]
        held.append(socket.socket(socket.AF_UNIX))
        held[-1].bind(f"\0labapp-device-{digest}")  # type: ignore[attr-defined]
    for place in (f"labapp-{os.getppid()}", "labapp-0", "labapp"):
        with suppress(OSError):
            (Path(gettempdir()) / place).mkdir()
            (Path(gettempdir()) / place).rmdir()
    return held


def _is_beside(file: Path, locked: bool) -> bool:
    """Whether this user uses a port that another has open, or isn't told who has it."""
    port = os.path.realpath(str(read_file(file, BenchFile).devices.filter.options["port"]))
    mode = os.stat(port).st_mode
    os.chmod(port, 0o666)

    def hold() -> int:
        handle = os.open(port, os.O_RDWR | os.O_NOCTTY)
        if locked:
            fcntl.flock(handle, fcntl.LOCK_EX)
        return handle

    try:
        with _held_by_nobody(hold), open_device(BenchFiles.with_defaults(file), "filter"):
            return True
    except DeviceError as error:
        return "of nobody" not in str(error)
    finally:
        os.chmod(port, mode)


@contextmanager
def _held_by_nobody(take: Callable[[], object]) -> Iterator[None]:
    """Something that a process of another user takes, and holds while the block runs."""
    reading, taken = os.pipe()

    def hold() -> None:
        held = take()
        os.write(taken, b"x")
        time.sleep(_HOLDS)
        del held

    process = _begin(hold, _NOBODY)
    os.close(taken)
    try:
        with open(reading, "rb") as told:
            assert told.read(1) == b"x"
        yield
    finally:
        os.kill(process, signal.SIGKILL)
        os.waitpid(process, 0)


def _is_free(tables: dict[str, DeviceTable]) -> bool:
    with suppress(UserError), lock_devices(tables):
        return True
    return False


def _has_left_files(folder: Path) -> bool:
    """Whether a file of the application's name belongs to the other user."""
    return any(file.lstat().st_uid == _NOBODY for file in folder.glob("*labapp*"))


def _succeeds(attempt: Callable[[], None], user: int) -> bool:
    """Whether a user can do that without an error."""
    _, status = os.waitpid(_begin(attempt, user), 0)
    return os.waitstatus_to_exitcode(status) == 0


def _begin(action: Callable[[], None], user: int) -> int:
    """Begin an action in a process of a user; its number."""
    process = os.fork()
    if process:
        return process
    code = 1
    try:
        if user == _NOBODY:
            os.setgroups([])
            os.setgid(_NOBODY)
            os.setuid(_NOBODY)
            # The owner's cookies can't be read.
            os.environ["XAUTHORITY"] = "/nowhere"
        action()
        code = 0
    finally:
        os._exit(code)


MEASUREMENTS = {"other user": intrusions}
