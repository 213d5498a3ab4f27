"""Call the library in its child process, with timeouts, and kill it if it hangs."""

from __future__ import annotations

import contextlib
import importlib.util
import mmap
import socket
import sys
import threading
import time
from multiprocessing.connection import wait
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.aravis.library.camera_control import HELD_BY_OTHER
from drivers.device_holders import udp_socket_holder
from drivers.errors import DeviceError
from drivers.hosted.calls import CallRequest
from drivers.hosted.child_process import ChildProcess, ProcessEnded

SYSTEM_PYTHON = "/usr/bin/python3"
"""The interpreter for which Linux distributions package gi."""

PACKAGES = "gir1.2-aravis-0.8 python3-gi"
"""Names of the needed packages in Debian and Ubuntu."""

_START_TIMEOUT = 10.0
"""Seconds within which the process must have loaded its library; chosen."""

_INSTALL = f"Install it with: sudo apt-get install --no-install-recommends {PACKAGES}"


class CameraLost(DeviceError):
    """Raised if the camera or the process is lost; the next call must open it again."""


class RequestRefused(DeviceError):
    """Raised if the library refuses a request; the camera is still connected."""


class AravisProcess:
    """Run the library in a child process, and call the methods of the classes in `library`.

    model: the camera's name in errors. DeviceError if Aravis isn't installed.
    """

    def __init__(self, model: str) -> None:
        self.model = model
        try:
            self._process = ChildProcess(
                "library.request_server:main",
                python=python_with_gi(),
                folders=[str(Path(__file__).parent)],
                # Seconds within which the process must have closed the camera and ended.
                grace=4.0,
            )
        except OSError as error:
            raise DeviceError(model, "open", f"no Python with gi: {error}", _INSTALL) from error
        self._mapped: mmap.mmap | None = None
        self._turn = threading.RLock()
        self._open = True

    def unplugged_reason(self) -> str | None:
        """Return why the camera counts as lost, empty while it doesn't; from any thread.

        None while a request is running, which then reports the loss itself, or when the process
        has ended.
        """
        if not self._turn.acquire(blocking=False):
            return None
        try:
            if not self._open or wait([self._process.exit_descriptor], 0):
                return None
            # Without a request, the process sends a message only when the camera is lost.
            return "it answers no more" if wait([self._process.line.fileno()], 0) else ""
        finally:
            self._turn.release()

    def ask(self, name: str, *given: Any, timeout: float) -> Any:
        """Call a method in the child process, and return its answer.

        RequestRefused if the library refuses. If no answer comes, the process is killed, and
        CameraLost is raised.
        """
        with self._turn:
            if not self._open:
                raise CameraLost(self.model, name, "its process is closed", "Take it again")
            # NumPy's floats are converted, because the other Python may not have NumPy.
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
        """Return bytes of the shared memory, which is `length` bytes long; no copy."""
        if self._mapped is None or len(self._mapped) != length:
            self._mapped = mmap.mmap(self._process.line.memory, length)
        return np.frombuffer(self._mapped, np.uint8, size, place)

    def kill(self) -> None:
        """Kill the process at once; from any thread, and any number of times."""
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
    """Return the command of a Python interpreter that can load gi, if there is one."""
    if importlib.util.find_spec("gi") is not None:
        return [sys.executable, "-P"]
    # -I hides this Python's packages, which may be built for another version.
    return [SYSTEM_PYTHON, "-I"]


def find_cameras() -> list[dict[str, str]]:
    """List the GigE Vision and USB3 Vision cameras that answer; takes a second.

    Returns
    -------
    list of dict
        For each camera: id, vendor, model, serial, address and protocol.

    Raises
    ------
    DeviceError
        If Aravis isn't installed.
    """
    link = AravisProcess("Aravis")
    try:
        return link.ask("find", timeout=_START_TIMEOUT)
    finally:
        link.close()


def open_camera(model: str, address: str, timeout: float) -> AravisProcess:
    """Start a child process and open a camera in it.

    The camera may still be reserved for a process that has died, so opening is tried for
    `timeout` seconds. If it fails, DeviceError lists the cameras that are connected.
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
    """Return the DeviceError for a camera that can't be opened, naming those that are found."""
    asked = f"open {address}" if address else "open"
    if HELD_BY_OTHER in error.reply:
        who = _name_controller(error.reply)
        reply = f"it is in use by {who}" if who else error.reply
        return DeviceError(link.model, asked, reply, "Close that first")
    there: list[dict[str, str]] = []
    with contextlib.suppress(DeviceError):
        there = link.ask("find", timeout=_START_TIMEOUT)
    words = [f"{c['id']} ({c['model']}, serial {c['serial']}, {c['address']})" for c in there]
    remedy = "Give one of: " + "; ".join(words) if words else "Plug one in, and look at its network"
    return DeviceError(link.model, asked, f"it can't be opened: {error.reply}", remedy)


def _name_controller(reply: str) -> str:
    """Return which program of this computer controls a camera; empty if none is known.

    reply: why the camera can't be opened, which may end in the program's IP address and UDP port.
    """
    address, _, port = reply.rpartition(" ")[2].partition(":")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            # Only this computer's own addresses can be bound.
            probe.bind((address, 0))
        except OSError:
            return ""
    return udp_socket_holder(int(port)) if port.isdigit() else ""
