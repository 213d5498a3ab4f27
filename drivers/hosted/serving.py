"""The life of a device's process, which alone runs what stands here."""

from __future__ import annotations

import contextlib
import inspect
import os
import pkgutil
import signal
import sys
import traceback
from collections.abc import Mapping, Sequence
from typing import Any

from drivers.clock import RealClock
from drivers.hosted.channel import Channel, Note
from drivers.hosted.failures import Failure
from drivers.hosted.flags import Flag
from drivers.hosted.guard import guard
from drivers.hosted.parcels import Parcel, pack
from drivers.hosted.process import IGNORED


def serve(end: str, memory: str, grace: str) -> None:
    """Do what is asked at `end` of a socket, until it is closed; then leave the device safe.

    end, memory: file descriptors. grace: seconds for that. All three from a command line,
    which isn't the device's: some libraries read it.
    """
    for number in IGNORED:
        signal.signal(number, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, IGNORED)
    del sys.argv[1:]
    for descriptor in (int(end), int(memory)):
        os.set_inheritable(descriptor, False)
    guard(int(end), float(grace))
    _Host(Channel(int(end), int(memory))).run()


class _Host:
    """Where the device lives."""

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
                request = self._channel.read(self._channel.connection.recv())
                self._channel.connection.send(self._reply(request))

    def _attend(self) -> None:
        """Let a device that has something to do between two calls do it, until one comes."""
        attend = getattr(type(self._device), "_attend_until_readable", None)
        if attend is not None:
            attend(self._device, self._channel.connection.fileno())

    def _reply(self, request: Parcel) -> Note:
        try:
            answer = self._obey(*request.unpacked())
        except BaseException as error:
            return self._channel.write(pack((False, Failure.of(error))))
        try:
            return self._channel.write(pack((True, answer)))
        except Exception as error:
            said = f"its answer can't leave its process: {error!r}"
            failure = Failure(None, said, "".join(traceback.format_exception(error)))
            return self._channel.write(pack((False, failure)))

    def _obey(
        self, command: str, name: str, arguments: Sequence[Any], options: Mapping[str, Any]
    ) -> Any:
        match command:
            case "open":
                return self._open(name, *arguments)
            case "enter":
                return self._enter()
            case "leave":
                self._left = True
                self._duties.pop_all()
                self._manager.__exit__(None, None, None)
                return None
            case "get":
                return getattr(self._device, name)
        with contextlib.ExitStack() as heard:
            for value in (*arguments, *options.values()):
                if isinstance(value, Flag):
                    heard.enter_context(value.heard(self._channel))
            return getattr(self._device, name)(*arguments, **options)

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


def _public(device: Any) -> dict[str, bool]:
    """The names that others may use, and whether each is a method; no property is read."""
    names = {}
    for name in dir(device):
        if not name.startswith("_"):
            thing = inspect.getattr_static(device, name, None)
            method = callable(thing) or isinstance(thing, classmethod)
            names[name] = method and not isinstance(thing, type)
    return names
