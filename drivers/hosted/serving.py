"""The child process's side: make the device and answer the calls that come for it."""

from __future__ import annotations

import contextlib
import inspect
import pkgutil
import traceback
from collections.abc import Mapping, Sequence
from typing import Any

from drivers.clock import RealClock
from drivers.hosted.calls import CallRequest, CallResult, capture_result
from drivers.hosted.failures import RemoteFailure
from drivers.hosted.flags import RemoteFlag
from drivers.hosted.message_socket import MessageSocket
from drivers.hosted.parcels import pack
from drivers.hosted.shared_memory_channel import ParcelHeader, SharedMemoryChannel


def serve(line: MessageSocket) -> None:
    """Serve requests until the line is closed; then make the device safe."""
    _Host(SharedMemoryChannel(line)).run()


class _Host:
    """Hold a device; a request has the name of the method that serves it."""

    def __init__(self, channel: SharedMemoryChannel) -> None:
        self._channel = channel
        self._device: Any = None
        # These functions run before the process ends, the last one first.
        self._duties = contextlib.ExitStack()
        self._device_closed = False

    def run(self) -> None:
        """Answer the requests, one by one, until the device is closed."""
        with self._duties, contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):
            while not self._device_closed:
                self._attend()
                request = self._channel.read(self._channel.line.receive())
                self._channel.line.send(
                    self._write_result(capture_result(self._obey, request.unpack))
                )

    def _attend(self) -> None:
        """Let the device do its own work between calls, until the next call arrives."""
        attend = getattr(type(self._device), "_attend_until_readable", None)
        if attend is not None:
            attend(self._device, self._channel.line.fileno())

    def _write_result(self, answer: CallResult) -> ParcelHeader:
        try:
            return self._channel.write(pack(answer))
        except Exception as error:
            said = f"its answer can't leave its process: {error!r}"
            failure = RemoteFailure(None, said, "".join(traceback.format_exception(error)))
            return self._channel.write(pack(CallResult(failure=failure)))

    def _obey(self, unpacked: Any) -> Any:
        """Carry out one request, with the method that it names."""
        request: CallRequest = unpacked()
        return getattr(self, f"_{request.name}")(*request.arguments)

    def _open(self, factory: str, start: float, options: Mapping[str, Any]) -> dict[str, bool]:
        from drivers.interfaces import Surroundings

        self._manager = pkgutil.resolve_name(factory)(Surroundings(RealClock(start)), **options)
        self._device = self._manager
        return _public_names(self._device)

    def _enter(self) -> dict[str, bool]:
        self._device = self._manager.__enter__()
        self._duties.push(self._manager.__exit__)
        self._duties.callback(self._device.make_safe)
        return _public_names(self._device)

    def _leave(self) -> None:
        self._device_closed = True
        self._duties.pop_all()
        self._manager.__exit__(None, None, None)

    def _get(self, name: str) -> Any:
        return getattr(self._device, name)

    def _call(self, name: str, arguments: Sequence[Any], options: Mapping[str, Any]) -> Any:
        with contextlib.ExitStack() as heard:
            for value in (*arguments, *options.values()):
                if isinstance(value, RemoteFlag):
                    heard.enter_context(value.listening_on(self._channel))
            return getattr(self._device, name)(*arguments, **options)


def _public_names(device: Any) -> dict[str, bool]:
    """Return a device's public names, and whether each is a method; read no property."""
    names = {}
    for name in dir(device):
        if not name.startswith("_"):
            thing = inspect.getattr_static(device, name, None)
            method = callable(thing) or isinstance(thing, classmethod)
            names[name] = method and not isinstance(thing, type)
    return names
