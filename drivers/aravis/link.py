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

from drivers.aravis.library.camera import OWNED
from drivers.errors import DeviceError
from drivers.hosted.calls import Request
from drivers.hosted.process import Ended, Process

SYSTEM_PYTHON = "/usr/bin/python3"
"""Where distributions put gi for."""

PACKAGES = "gir1.2-aravis-0.8 python3-gi"
"""What Debian and Ubuntu call what is needed."""

_STARTING = 10.0
"""Seconds in which the process must have loaded its library."""

_LEAVING = 4.0
"""Seconds in which the process must have closed the camera and ended."""

_INSTALL = f"Install it with: sudo apt-get install --no-install-recommends {PACKAGES}"


class Gone(DeviceError):
    """The camera or its process is lost: the next call has to open it again."""


class Refused(DeviceError):
    """The library says no; the camera is still there."""


class Link:
    """A process of Aravis, which may be asked what the classes in `library` have methods for.

    model: the camera's name in errors. DeviceError if there is no Aravis.
    """

    def __init__(self, model: str) -> None:
        self.model = model
        try:
            self._process = Process(
                "library.desk:main",
                python=python_with_gi(),
                folders=[str(Path(__file__).parent)],
                grace=_LEAVING,
            )
        except OSError as error:
            raise DeviceError(model, "open", f"no Python with gi: {error}", _INSTALL) from error
        self._mapped: mmap.mmap | None = None
        self._turn = threading.RLock()
        self._open = True

    def gone(self) -> str | None:
        """Why the camera counts as lost, empty while it doesn't; from any thread.

        None while something is asked, which is told then, or when its process has ended.
        """
        if not self._turn.acquire(blocking=False):
            return None
        try:
            if not self._open or wait([self._process.ended], 0):
                return None
            # Nothing was asked, and its process says by itself only that the camera is lost.
            return "it answers no more" if wait([self._process.line.fileno()], 0) else ""
        finally:
            self._turn.release()

    def ask(self, name: str, *given: Any, within: float) -> Any:
        """What the library answers. Refused if it says no; Gone, and killed, if nothing comes."""
        with self._turn:
            if not self._open:
                raise Gone(self.model, name, "its process is closed", "Take it again")
            # Numpy's numbers are floats, too, but the other Python may not know them.
            plain = [float(one) if isinstance(one, float) else one for one in given]
            self._process.tell(Request(name, plain))
            try:
                return self._process.next(within).result()
            except Ended as ended:
                raise self._death(name, str(ended)) from ended
            except ConnectionError as lost:
                raise self._death(name, str(lost)) from lost
            except (ImportError, ValueError) as missing:
                self.kill()
                reply = f"Aravis isn't there: {missing}"
                raise DeviceError(self.model, "open", reply, _INSTALL) from missing
            except RuntimeError as refusal:
                remedy = "Look at the camera's settings, its network and its cable"
                raise Refused(self.model, name.replace("_", " "), str(refusal), remedy) from refusal

    def _death(self, name: str, reply: str) -> Gone:
        self.kill()
        remedy = "Look at the camera's power and cable, and take it again"
        return Gone(self.model, name.replace("_", " "), reply, remedy)

    def bytes_at(self, place: int, size: int, length: int) -> NDArray[np.uint8]:
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


def found_cameras() -> list[dict[str, str]]:
    """The cameras that answer: id, vendor, model, serial, address, protocol. Takes a second.

    DeviceError if there is no Aravis.
    """
    link = Link("Aravis")
    try:
        return link.ask("find", within=_STARTING)
    finally:
        link.close()


def opened(model: str, address: str, patience: float) -> Link:
    """A process that has opened a camera, which may still be held by one that has died.

    patience: seconds for which it is tried. DeviceError that lists those that are there.
    """
    link = Link(model)
    try:
        late = time.monotonic() + patience
        while True:
            try:
                link.ask("open", address, within=_STARTING)
                return link
            except Refused as error:
                if time.monotonic() > late:
                    raise _no_camera(link, address, error) from error
            time.sleep(0.1)
    except BaseException:
        link.kill()
        link.close()
        raise


def _no_camera(link: Link, address: str, error: DeviceError) -> DeviceError:
    asked = f"open {address}" if address else "open"
    if OWNED in error.reply:
        return DeviceError(link.model, asked, error.reply, "Close the other program")
    there: list[dict[str, str]] = []
    with contextlib.suppress(DeviceError):
        there = link.ask("find", within=_STARTING)
    words = [f"{c['id']} ({c['model']}, serial {c['serial']}, {c['address']})" for c in there]
    remedy = "Give one of: " + "; ".join(words) if words else "Plug one in, and look at its network"
    return DeviceError(link.model, asked, f"it can't be opened: {error.reply}", remedy)
