"""The life of Aravis' process: it answers requests one by one."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

from drivers.hosted.calls import Answer, Request, answer_of
from drivers.hosted.line import Line

from .camera import Camera
from .frames import Frames
from .settings import Settings

_OBEYED = ("set_exposure", "set_gain", "trigger", "exposure", "start")
"""After these it is looked whether the camera still obeys us."""


class _Desk:
    """Takes requests one by one; says at once if the camera is lost, while one lasts or not.

    A request is named as the method that answers it: of the camera, its settings or its frames.
    """

    def __init__(self, line: Line, camera: Camera, frames: Frames) -> None:
        self._line, self._camera = line, camera
        self._answering = (camera, Settings(camera), frames)
        self._owed = self._told = False
        self._lock = threading.Lock()
        threading.Thread(target=self._watch, daemon=True).start()

    def run(self) -> None:
        with contextlib.suppress(EOFError, OSError):
            while True:
                request: Request = self._line.receive()
                self._owed = True
                self._send(answer_of(self._done, request.name, request.given))

    def _done(self, name: str, given: Sequence[Any]) -> Any:
        """The answer. ConnectionError if the camera is lost, RuntimeError if it says no."""
        self._require_camera()
        try:
            answer = self._method(name)(*given)
            if name in _OBEYED:
                # A camera that obeys somebody else may have been set anew by them.
                self._camera.look()
        except Exception as error:
            self._require_camera()
            words = getattr(error, "message", "") or str(error) or repr(error)
            raise RuntimeError(words) from error
        if self._camera.lost:
            raise ConnectionError(self._camera.lost)
        return answer

    def _require_camera(self) -> None:
        if self._camera.gone():
            raise ConnectionError(self._camera.lost)

    def _method(self, name: str) -> Callable[..., Any]:
        found: Callable[..., Any] = next(
            getattr(one, name) for one in self._answering if hasattr(one, name)
        )
        return found

    def _send(self, answer: Answer) -> None:
        with self._lock:
            if self._owed:
                self._owed = False
                self._line.send(answer)

    def _tell_lost(self) -> None:
        """Once, asked or not: whoever asks next takes it for the answer, which it is."""
        with self._lock:
            if not self._told:
                self._told, self._owed = True, False
                self._line.send(answer_of(self._require_camera))

    def _watch(self) -> None:
        while not self._told:
            time.sleep(0.05)
            if self._camera.gone():
                with contextlib.suppress(OSError):
                    self._tell_lost()


def main(line: Line) -> None:
    """Serve until nobody asks any more. Frames lie in the line's memory."""
    import gi

    gi.require_version("Aravis", "0.8")
    from gi.repository import Aravis

    camera = Camera(Aravis)
    frames = Frames(camera, line.memory)
    try:
        _Desk(line, camera, frames).run()
    finally:
        with contextlib.suppress(Exception):
            frames.stop()
        camera.close()
