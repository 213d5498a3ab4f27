"""The connection to a UVC camera: a stream that is begun again where it has ended."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from drivers.errors import DeviceError
from drivers.uvc.capture import Mode, Source, configured, describe, path_of
from drivers.uvc.stream import Stopped, Stream

T = TypeVar("T")

OPENING = 5.0
"""Seconds for a call to the camera, its opening included."""

_ENDING = 2.0
"""Seconds for a stream to end."""

_CABLE = "Check its cable, and that no other program uses it"


class Connection:
    """To one camera. model: its name in errors until it tells one itself.

    begun: called with every new stream, whose camera is as it was when it was plugged in.
    told: what the camera was when it was opened first.
    """

    def __init__(
        self, model: str, mode: Mode, source: Source, begun: Callable[[str, Stream], None]
    ) -> None:
        self.stream: Stream | None = None
        self.told: dict[str, str] = {}
        self._model, self._mode, self._source, self._begun = model, mode, source, begun
        # One that was given up, which may hold the camera still.
        self._left: Stream | None = None
        self._was_there = False

    @property
    def model(self) -> str:
        return self.told.get("name", "") or self._model

    def ready(self, command: str) -> Stream:
        """The stream, begun again if it has ended: then it must be the same camera."""
        stream = self.stream
        if stream is not None and not stream.ended:
            return stream
        self.stop()
        if self._left is not None and not self._left.stop(_ENDING):
            raise self.refuse(
                command, "it hangs in the system", "Pull its plug, and use own_process = true"
            )
        self._left = None
        self.stream = stream = Stream(lambda: configured(self._mode, self._source))
        told = self.ask(command, stream, lambda capture: describe(capture, self._mode.device))
        if self.told and told != self.told:
            raise self.lost(command, f"another camera has taken its place: {told}")
        self.told = told
        self._was_there = path_of(self._mode.device).exists()
        self._begun(command, stream)
        return stream

    def ask(
        self, command: str, stream: Stream, work: Callable[[Any], T], seconds: float = OPENING
    ) -> T:
        """Have something done with the VideoCapture of a stream that ready() gave."""
        try:
            return stream.ask(work, seconds)
        except Stopped as stopped:
            raise self.lost(command, str(stopped)) from None
        except Exception as error:
            raise self.lost(command, f"{type(error).__name__}: {error}") from error

    def lost(self, command: str, why: str) -> DeviceError:
        """What is wrong with a stream, which is ended: the next command begins another."""
        self.stop(0.0)
        if self.gone():
            return self.refuse(command, "it was unplugged", "Plug it in again")
        return self.refuse(command, why, _CABLE)

    def gone(self) -> str | None:
        """Why the camera counts as unplugged, empty while it is there, None if nobody knows."""
        if not self._was_there:
            return None
        path = path_of(self._mode.device)
        return "" if path.exists() else f"{path} isn't there any more"

    def stop(self, seconds: float = _ENDING) -> None:
        stream, self.stream = self.stream, None
        if stream is not None and not stream.stop(seconds):
            self._left = stream

    def refuse(self, command: str, reply: str, remedy: str) -> DeviceError:
        return DeviceError(self.model, command, reply, remedy)
