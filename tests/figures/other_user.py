"""What another user of the computer can do to a virtual bench that is served to real drivers."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from tempfile import gettempdir

from drivers.x11 import XConnection
from figures import Figure
from figures.expected_time import served_bench
from labapp.bench.locking import lock_devices
from labapp.common.errors import UserError
from labapp.files.bench_file import BenchFile, DeviceTable
from labapp.files.reading import read_file

_NOBODY = 65534
"""Number of the user `nobody`, and of its group."""

_LOCKS_WITHIN = 10.0
"""Seconds after which a process that hasn't locked a device won't. Chosen."""

_NAME = (
    "another user of a served bench: X pixels read or drawn, port opened, device opened twice, "
    "lasting denial"
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
            **_camera_twice({"camera": tables["camera"]}),
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


def _camera_twice(tables: dict[str, DeviceTable]) -> dict[str, bool]:
    """Which of two users that both want the camera get it at the same time, and afterwards."""
    assert _succeeds(lambda: _lock(tables), _NOBODY)
    with lock_devices(tables):
        beside_us = _succeeds(lambda: _lock(tables), _NOBODY)
    reading, locked = os.pipe()
    process = _begin(lambda: _hold(tables, locked), _NOBODY)
    os.close(locked)
    with open(reading, "rb") as told:
        told.read(1)
    beside_them = _is_free(tables)
    os.kill(process, signal.SIGKILL)
    os.waitpid(process, 0)
    late = time.monotonic() + _LOCKS_WITHIN
    while not (free := _is_free(tables)) and time.monotonic() < late:
        time.sleep(0.05)
    return {
        "the camera opened beside us": beside_us,
        "the camera opened beside them": beside_them,
        "the camera locked for good": not free,
    }


def _lock(tables: dict[str, DeviceTable]) -> None:
    with lock_devices(tables):
        pass


def _hold(tables: dict[str, DeviceTable], locked: int) -> None:
    with lock_devices(tables):
        os.write(locked, b"x")
        time.sleep(10 * _LOCKS_WITHIN)


def _is_free(tables: dict[str, DeviceTable]) -> bool:
    with suppress(UserError):
        _lock(tables)
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
