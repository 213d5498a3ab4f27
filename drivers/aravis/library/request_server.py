"""Serve the parent's requests to a camera, one by one."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

from drivers.hosted.calls import CallRequest, CallResult, capture_result
from drivers.hosted.message_socket import MessageSocket

from .camera_control import CameraControl
from .camera_state import CameraState
from .features import CameraFeatures
from .frame_stream import FrameStream

_CHECK_CONTROL_AFTER = ("set_exposure", "set_gain", "trigger", "exposure", "changes", "start")
"""Requests after which the server checks that this process still controls the camera."""


class _RequestServer:
    """Answer requests one by one, and report a lost camera at once, even during a request.

    A request has the name of the method that answers it: of CameraControl, CameraFeatures,
    CameraState or FrameStream.
    """

    def __init__(self, line: MessageSocket, camera: CameraControl, frames: FrameStream) -> None:
        self._line, self._camera = line, camera
        self._targets = (camera, CameraFeatures(camera), CameraState(camera), frames)
        self._reply_pending = self._loss_reported = False
        self._lock = threading.Lock()
        threading.Thread(target=self._watch, daemon=True).start()

    def run(self) -> None:
        with contextlib.suppress(EOFError, OSError):
            while True:
                request: CallRequest = self._line.receive()
                self._reply_pending = True
                self._send(capture_result(self._execute, request.name, request.arguments))

    def _execute(self, name: str, given: Sequence[Any]) -> Any:
        """Carry out a request; return the library's answer.

        ConnectionError if the camera is lost, RuntimeError if the library refuses the request.
        """
        self._require_camera()
        try:
            answer = self._method(name)(*given)
            if name in _CHECK_CONTROL_AFTER:
                # Another program that controls the camera may have changed its settings.
                self._camera.check_control()
        except Exception as error:
            self._require_camera()
            words = getattr(error, "message", "") or str(error) or repr(error)
            raise RuntimeError(words) from error
        if self._camera.lost:
            raise ConnectionError(self._camera.lost)
        return answer

    def _require_camera(self) -> None:
        if self._camera.lost_reason():
            raise ConnectionError(self._camera.lost)

    def _method(self, name: str) -> Callable[..., Any]:
        found: Callable[..., Any] = next(
            getattr(one, name) for one in self._targets if hasattr(one, name)
        )
        return found

    def _send(self, answer: CallResult) -> None:
        with self._lock:
            if self._reply_pending:
                self._reply_pending = False
                self._line.send(answer)

    def _report_loss(self) -> None:
        """Report the loss of the camera once; this also answers a pending request."""
        with self._lock:
            if not self._loss_reported:
                self._loss_reported, self._reply_pending = True, False
                self._line.send(capture_result(self._require_camera))

    def _watch(self) -> None:
        """Wait for the loss of the camera, and report it."""
        while not self._loss_reported:
            time.sleep(0.05)
            if self._camera.lost_reason():
                with contextlib.suppress(OSError):
                    self._report_loss()


def main(line: MessageSocket) -> None:
    """Serve requests until the parent hangs up.

    The frames are written to the memory that `line` shares with the parent.
    """
    import gi

    gi.require_version("Aravis", "0.8")
    from gi.repository import Aravis

    camera = CameraControl(Aravis)
    frames = FrameStream(camera, line.memory)
    try:
        _RequestServer(line, camera, frames).run()
    finally:
        with contextlib.suppress(Exception):
            frames.stop()
        camera.close()
