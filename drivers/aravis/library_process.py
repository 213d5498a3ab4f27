"""Aravis' process, as seen from here: it is asked, waited for, and killed if it hangs."""

from __future__ import annotations

import contextlib
import importlib.util
import mmap
import sys
import threading
import time
from multiprocessing.connection import wait
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.aravis.library.camera_control import HELD_BY_OTHER
from drivers.errors import DeviceError
from drivers.hosted.calls import CallRequest
from drivers.hosted.child_process import ChildProcess, ProcessEnded

SYSTEM_PYTHON = "/usr/bin/python3"
"""Where distributions put gi for."""

PACKAGES = "gir1.2-aravis-0.8 python3-gi"
"""What Debian and Ubuntu call what is needed."""

_START_TIMEOUT = 10.0
"""Seconds in which the process must have loaded its library."""

_CLOSE_TIMEOUT = 4.0
"""Seconds in which the process must have closed the camera and ended."""

_INSTALL = f"Install it with: sudo apt-get install --no-install-recommends {PACKAGES}"


class CameraLost(DeviceError):
    """The camera or its process is lost: the next call has to open it again."""


class RequestRefused(DeviceError):
    """The library says no; the camera is still there."""


class AravisProcess:
    """A process of Aravis, which may be asked what the classes in `library` have methods for.

    model: the camera's name in errors. DeviceError if there is no Aravis.
    """

    def __init__(self, model: str) -> None:
        self.model = model
        try:
            self._process = ChildProcess(
                "library.request_server:main",
                python=python_with_gi(),
                folders=[str(Path(__file__).parent)],
                grace=_CLOSE_TIMEOUT,
            )
        except OSError as error:
            raise DeviceError(model, "open", f"no Python with gi: {error}", _INSTALL) from error
        self._mapped: mmap.mmap | None = None
        self._turn = threading.RLock()
        self._open = True

    def unplugged_reason(self) -> str | None:
        """Why the camera counts as lost, empty while it doesn't; from any thread.

        None while something is asked, which is told then, or when its process has ended.
        """
        if not self._turn.acquire(blocking=False):
            return None
        try:
            if not self._open or wait([self._process.exit_descriptor], 0):
                return None
            # Nothing was asked, and its process says by itself only that the camera is lost.
            return "it answers no more" if wait([self._process.line.fileno()], 0) else ""
        finally:
            self._turn.release()

    def ask(self, name: str, *given: Any, timeout: float) -> Any:
        """What the library answers.

        RequestRefused if it says no; CameraLost, and the process killed, if nothing comes.
        """
        with self._turn:
            if not self._open:
                raise CameraLost(self.model, name, "its process is closed", "Take it again")
            # Numpy's numbers are floats, too, but the other Python may not know them.
            plain = [float(one) if isinstance(one, float) else one for one in given]
            self._process.send(CallRequest(name, plain))
            try:
                return self._process.receive(timeout).result()
            except ProcessEnded as ended:
                raise self._process_lost(name, str(ended)) from ended
            except ConnectionError as lost:
                raise self._process_lost(name, str(lost)) from lost
            except (ImportError, ValueError) as missing:
                self.kill()
                reply = f"Aravis isn't there: {missing}"
                raise DeviceError(self.model, "open", reply, _INSTALL) from missing
            except RuntimeError as refusal:
                remedy = "Look at the camera's settings, its network and its cable"
                raise RequestRefused(
                    self.model, name.replace("_", " "), str(refusal), remedy
                ) from refusal

    def _process_lost(self, name: str, reply: str) -> CameraLost:
        self.kill()
        remedy = "Look at the camera's power and cable, and take it again"
        return CameraLost(self.model, name.replace("_", " "), reply, remedy)

    def shared_bytes(self, place: int, size: int, length: int) -> NDArray[np.uint8]:
        """What lies in the memory that both see, `length` bytes long; not a copy."""
        if self._mapped is None or len(self._mapped) != length:
            self._mapped = mmap.mmap(self._process.line.memory, length)
        return np.frombuffer(self._mapped, np.uint8, size, place)

    def kill(self) -> None:
        """End the process at once; from any thread, as often as you like."""
        self._process.kill()

    def close(self) -> None:
        """Let the process close the camera and end; kill it if it doesn't."""
        with self._turn:
            if not self._open:
                return
            self._open = False
        self._process.close()
        self._mapped = None


def python_with_gi() -> list[str]:
    """The command of a Python that can load Aravis, if any can."""
    if importlib.util.find_spec("gi") is not None:
        return [sys.executable, "-P"]
    # Nothing of this Python's packages: they may be of another version.
    return [SYSTEM_PYTHON, "-I"]


def find_cameras() -> list[dict[str, str]]:
    """The cameras that answer: id, vendor, model, serial, address, protocol. Takes a second.

    DeviceError if there is no Aravis.
    """
    link = AravisProcess("Aravis")
    try:
        return link.ask("find", timeout=_START_TIMEOUT)
    finally:
        link.close()


def open_camera(model: str, address: str, timeout: float) -> AravisProcess:
    """A process that has opened a camera, which may still be held by one that has died.

    timeout: seconds for which it is tried. DeviceError that lists those that are there.
    """
    link = AravisProcess(model)
    try:
        late = time.monotonic() + timeout
        while True:
            try:
                link.ask("open", address, timeout=_START_TIMEOUT)
                return link
            except RequestRefused as error:
                if time.monotonic() > late:
                    raise _cannot_open_error(link, address, error) from error
            time.sleep(0.1)
    except BaseException:
        link.kill()
        link.close()
        raise


def _cannot_open_error(link: AravisProcess, address: str, error: DeviceError) -> DeviceError:
    asked = f"open {address}" if address else "open"
    if HELD_BY_OTHER in error.reply:
        return DeviceError(link.model, asked, error.reply, "Close the other program")
    there: list[dict[str, str]] = []
    with contextlib.suppress(DeviceError):
        there = link.ask("find", timeout=_START_TIMEOUT)
    words = [f"{c['id']} ({c['model']}, serial {c['serial']}, {c['address']})" for c in there]
    remedy = "Give one of: " + "; ".join(words) if words else "Plug one in, and look at its network"
    return DeviceError(link.model, asked, f"it can't be opened: {error.reply}", remedy)
