"""The connection to a UVC camera: a stream that is begun again where it has ended."""

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
"""Seconds for a call to the camera, its opening included."""

_STOP_TIMEOUT = 2.0
"""Seconds for a stream to end."""

_CABLE = "Check its cable, and that no other program uses it"


class CameraConnection:
    """To one camera. model: its name in errors until it tells one itself.

    on_new_stream: called with every new stream, whose camera is as it was when it was plugged in.
    description: what the camera was when it was opened first.
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
        # One that was given up, which may hold the camera still.
        self._abandoned_stream: Stream | None = None
        self._had_device_file = False

    @property
    def model(self) -> str:
        return self.description.get("name", "") or self._model

    def ensure_stream(self, command: str) -> Stream:
        """The stream, begun again if it has ended: then it must be the same camera."""
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
        """Have something done with the VideoCapture of a stream that ensure_stream() gave."""
        try:
            return stream.run_between_frames(work, seconds)
        except StreamStopped as stopped:
            raise self.end_with_error(command, str(stopped)) from None
        except Exception as error:
            raise self.end_with_error(command, f"{type(error).__name__}: {error}") from error

    def end_with_error(self, command: str, why: str) -> DeviceError:
        """What is wrong with a stream, which is ended: the next command begins another."""
        self.stop(0.0)
        if self.unplugged_reason():
            return self.refuse(command, "it was unplugged", "Plug it in again")
        return self.refuse(command, why, _CABLE)

    def unplugged_reason(self) -> str | None:
        """Why the camera counts as unplugged, empty while it is there, None if nobody knows."""
        if not self._had_device_file:
            return None
        path = device_path(self._mode.device)
        return "" if path.exists() else f"{path} isn't there any more"

    def stop(self, seconds: float = _STOP_TIMEOUT) -> None:
        stream, self.stream = self.stream, None
        if stream is not None and not stream.stop(seconds):
            self._abandoned_stream = stream

    def refuse(self, command: str, reply: str, remedy: str) -> DeviceError:
        return DeviceError(self.model, command, reply, remedy)
