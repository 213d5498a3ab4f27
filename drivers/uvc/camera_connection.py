"""Keep a camera's stream, and restart it when it has ended."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from drivers.errors import DeviceError
from drivers.uvc.capture import (
    CaptureFactory,
    CaptureMode,
    describe_camera,
    device_path,
    open_capture,
)
from drivers.uvc.stream import Stream, StreamStopped

T = TypeVar("T")

CALL_TIMEOUT = 5.0
"""Seconds for a call to the camera, including its opening; chosen."""

_STOP_TIMEOUT = 2.0
"""Seconds within which a stream must have ended; chosen."""

_CABLE = "Check its cable, and that no other program uses it"


class CameraConnection:
    """Hold the connection to one camera.

    model: the name in errors until the camera's own is known. on_new_stream: called with every
    new stream, on which the camera has its default settings. description: what the camera
    reported about itself when it was first opened.
    """

    def __init__(
        self,
        model: str,
        mode: CaptureMode,
        source: CaptureFactory,
        on_new_stream: Callable[[str, Stream], None],
    ) -> None:
        self.stream: Stream | None = None
        self.description: dict[str, str] = {}
        self._model, self._mode, self._source, self._begun = model, mode, source, on_new_stream
        # A stream that was abandoned because it hung; it may still occupy the camera.
        self._abandoned_stream: Stream | None = None
        self._had_device_file = False

    @property
    def model(self) -> str:
        return self.description.get("name", "") or self._model

    def ensure_stream(self, command: str) -> Stream:
        """Return the stream; if it has ended, restart it and check the identity."""
        stream = self.stream
        if stream is not None and not stream.end_reason:
            return stream
        self.stop()
        if self._abandoned_stream is not None and not self._abandoned_stream.stop(_STOP_TIMEOUT):
            raise self.refuse(
                command, "it hangs in the system", "Pull its plug, and use own_process = true"
            )
        self._abandoned_stream = None
        self.stream = stream = Stream(lambda: open_capture(self._mode, self._source))
        told = self.ask(
            command, stream, lambda capture: describe_camera(capture, self._mode.device)
        )
        if self.description and told != self.description:
            raise self.end_with_error(command, f"another camera has taken its place: {told}")
        self.description = told
        self._had_device_file = device_path(self._mode.device).exists()
        self._begun(command, stream)
        return stream

    def ask(
        self, command: str, stream: Stream, work: Callable[[Any], T], seconds: float = CALL_TIMEOUT
    ) -> T:
        """Run `work` on the stream's VideoCapture, between two frames."""
        try:
            return stream.run_between_frames(work, seconds)
        except StreamStopped as stopped:
            raise self.end_with_error(command, str(stopped)) from None
        except Exception as error:
            raise self.end_with_error(command, f"{type(error).__name__}: {error}") from error

    def end_with_error(self, command: str, why: str) -> DeviceError:
        """End the stream and return its error; the next command restarts it."""
        self.stop(0.0)
        if self.unplugged_reason():
            return self.refuse(command, "it was unplugged", "Plug it in again")
        return self.refuse(command, why, _CABLE)

    def unplugged_reason(self) -> str | None:
        """Return why the camera counts as unplugged, empty while connected, None if unknown."""
        if not self._had_device_file:
            return None
        path = device_path(self._mode.device)
        return "" if path.exists() else f"{path} isn't there any more"

    def stop(self, seconds: float = _STOP_TIMEOUT) -> None:
        stream, self.stream = self.stream, None
        if stream is not None and not stream.stop(seconds):
            self._abandoned_stream = stream

    def refuse(self, command: str, reply: str, remedy: str) -> DeviceError:
        """Return the DeviceError for a command that failed."""
        return DeviceError(self.model, command, reply, remedy)
