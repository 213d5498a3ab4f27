"""The life of Aravis' process: answers requests in JSON at a socket, one by one."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import threading
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

from .camera import Camera
from .frames import Frames
from .settings import Settings

_ORPHANED = 10.0
"""Seconds in which this process must have ended after its parent has."""

_OBEYED = ("set_exposure", "set_gain", "trigger", "exposure", "start")
"""After these it is looked whether the camera still obeys us."""


class _Desk:
    """Takes requests one by one; says at once if the camera is lost while one lasts.

    A request is named as the method that answers it: of the camera, its settings or its frames.
    """

    def __init__(self, end: Connection, camera: Camera, frames: Frames) -> None:
        self._end, self._camera = end, camera
        self._answering = (camera, Settings(camera), frames)
        self._owed = False
        self._lock = threading.Lock()
        threading.Thread(target=self._attend, daemon=True).start()

    def run(self) -> None:
        with contextlib.suppress(EOFError, OSError):
            while True:
                request = json.loads(self._end.recv_bytes())
                self._owed = True
                self._answer(self._done(**request))

    def _done(self, name: str, given: list[Any]) -> dict[str, Any]:
        if self._camera.gone():
            return {"lost": self._camera.lost}
        try:
            answer = self._method(name)(*given)
            if name in _OBEYED:
                # A camera that obeys somebody else may have been set anew by them.
                self._camera.look()
            return {"lost": self._camera.lost} if self._camera.lost else {"good": answer}
        except Exception as error:
            if self._camera.gone():
                return {"lost": self._camera.lost}
            return {"bad": getattr(error, "message", "") or str(error) or repr(error)}

    def _method(self, name: str) -> Callable[..., Any]:
        found: Callable[..., Any] = next(
            getattr(one, name) for one in self._answering if hasattr(one, name)
        )
        return found

    def _answer(self, answer: dict[str, Any]) -> None:
        with self._lock:
            if self._owed:
                self._owed = False
                self._end.send_bytes(json.dumps(answer).encode())

    def _attend(self) -> None:
        parent = os.getppid()
        while True:
            time.sleep(0.05)
            if self._owed and self._camera.gone():
                with contextlib.suppress(OSError):
                    self._answer({"lost": self._camera.lost})
            if os.getppid() != parent:
                time.sleep(_ORPHANED)
                os._exit(1)


def main(end: str, memory: str) -> None:
    """Serve until nobody asks any more. end, memory: numbers of descriptors."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_SETMASK, ())
    connection = Connection(int(end))
    for descriptor in (int(end), int(memory)):
        os.set_inheritable(descriptor, False)
    try:
        import gi

        gi.require_version("Aravis", "0.8")
        from gi.repository import Aravis
    except (ImportError, ValueError) as error:
        connection.recv_bytes()
        connection.send_bytes(json.dumps({"missing": str(error)}).encode())
        return
    camera = Camera(Aravis)
    frames = Frames(camera, int(memory))
    try:
        _Desk(connection, camera, frames).run()
    finally:
        with contextlib.suppress(Exception):
            frames.stop()
        camera.close()
