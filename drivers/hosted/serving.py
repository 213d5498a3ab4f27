"""The life of a device in a process of its own, which alone runs what stands here."""

from __future__ import annotations

import contextlib
import inspect
import pkgutil
import traceback
from collections.abc import Mapping, Sequence
from typing import Any

from drivers.clock import RealClock
from drivers.hosted.calls import Answer, Request, answer_of
from drivers.hosted.channel import Channel, Note
from drivers.hosted.failures import Failure
from drivers.hosted.flags import Flag
from drivers.hosted.line import Line
from drivers.hosted.parcels import pack


def serve(line: Line) -> None:
    """Do what is asked until the line is closed; then leave the device safe."""
    _Host(Channel(line)).run()


class _Host:
    """Where the device lives. A request is named as the method that answers it."""

    def __init__(self, channel: Channel) -> None:
        self._channel = channel
        self._device: Any = None
        # What is to be done before this process ends, the last first.
        self._duties = contextlib.ExitStack()
        self._left = False

    def run(self) -> None:
        with self._duties, contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):
            while not self._left:
                self._attend()
                request = self._channel.read(self._channel.line.receive())
                self._channel.line.send(self._note_of(answer_of(self._obey, request.unpacked)))

    def _attend(self) -> None:
        """Let a device that has something to do between two calls do it, until one comes."""
        attend = getattr(type(self._device), "_attend_until_readable", None)
        if attend is not None:
            attend(self._device, self._channel.line.fileno())

    def _note_of(self, answer: Answer) -> Note:
        try:
            return self._channel.write(pack(answer))
        except Exception as error:
            said = f"its answer can't leave its process: {error!r}"
            failure = Failure(None, said, "".join(traceback.format_exception(error)))
            return self._channel.write(pack(Answer(failure=failure)))

    def _obey(self, unpacked: Any) -> Any:
        request: Request = unpacked()
        return getattr(self, f"_{request.name}")(*request.given)

    def _open(self, factory: str, start: float, options: Mapping[str, Any]) -> dict[str, bool]:
        from drivers.interfaces import Surroundings

        self._manager = pkgutil.resolve_name(factory)(Surroundings(RealClock(start)), **options)
        self._device = self._manager
        return _public(self._device)

    def _enter(self) -> dict[str, bool]:
        self._device = self._manager.__enter__()
        self._duties.push(self._manager.__exit__)
        self._duties.callback(self._device.make_safe)
        return _public(self._device)

    def _leave(self) -> None:
        self._left = True
        self._duties.pop_all()
        self._manager.__exit__(None, None, None)

    def _get(self, name: str) -> Any:
        return getattr(self._device, name)

    def _call(self, name: str, arguments: Sequence[Any], options: Mapping[str, Any]) -> Any:
        with contextlib.ExitStack() as heard:
            for value in (*arguments, *options.values()):
                if isinstance(value, Flag):
                    heard.enter_context(value.heard(self._channel))
            return getattr(self._device, name)(*arguments, **options)


def _public(device: Any) -> dict[str, bool]:
    """The names that others may use, and whether each is a method; no property is read."""
    names = {}
    for name in dir(device):
        if not name.startswith("_"):
            thing = inspect.getattr_static(device, name, None)
            method = callable(thing) or isinstance(thing, classmethod)
            names[name] = method and not isinstance(thing, type)
    return names
