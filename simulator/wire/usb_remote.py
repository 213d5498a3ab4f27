"""USB devices of another process, as a pyusb backend over a local socket.

`with UsbServer(bus, path)` serves a bus. A driver in another process of the same user reaches it by
its option backend = "simulated@PATH". A key file beside the socket, which other users can't read,
protects it.
"""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
import threading
from multiprocessing.connection import Client, Connection, Listener
from pathlib import Path
from typing import Any, Self

from drivers.hosted.calls import CallRequest, CallResult, capture_result
from drivers.hosted.message_socket import MessageSocket
from simulator.machines.usb import SetupPacket
from simulator.wire.usb_backend import Handle, SimulatedUsbBackend, UsbBus
from simulator.wire.usb_plug import usb_error

_FORWARDED_CALLS = (
    "enumerate_devices", "get_device_descriptor", "get_configuration_descriptor",
    "get_interface_descriptor", "get_endpoint_descriptor", "open_device", "set_configuration",
    "get_configuration", "set_interface_altsetting", "claim_interface", "release_interface",
    "is_kernel_driver_active", "detach_kernel_driver", "attach_kernel_driver", "clear_halt",
    "reset_device", "control", "read", "write",
)  # fmt: skip


def backend_option(path: str | Path) -> str:
    """Return the drivers' option `backend` for a bus that is served at a path."""
    return f"simulated@{path}"


def _key_file(path: str | Path) -> Path:
    return Path(f"{path}.key")


class UsbServer:
    """Serve a bus to drivers in other processes, by a socket at `path`.

    It is a context manager and serves until it is left.
    """

    def __init__(self, bus: UsbBus, path: str | Path) -> None:
        self._bus = bus
        self._path = str(path)
        self._lines: list[MessageSocket] = []
        self._ended = False

    def __enter__(self) -> Self:
        key = secrets.token_bytes(32)
        file = _key_file(self._path)
        file.unlink(missing_ok=True)
        with os.fdopen(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as out:
            out.write(key)
        Path(self._path).unlink(missing_ok=True)
        self._listener = Listener(self._path, "AF_UNIX", authkey=key)
        threading.Thread(target=self._accept, name="USB bus", daemon=True).start()
        return self

    def __exit__(self, *error: object) -> None:
        self._ended = True
        # Closing the listener doesn't end accept() in the other thread, but a connection does.
        with contextlib.suppress(OSError, EOFError):
            Client(self._path, "AF_UNIX").close()
        self._listener.close()
        for line in self._lines:
            line.disconnect()
        _key_file(self._path).unlink(missing_ok=True)

    def _accept(self) -> None:
        while not self._ended:
            try:
                line = _message_socket(self._listener.accept())
            except Exception:
                # The client doesn't know the key or has closed the connection.
                continue
            self._lines.append(line)
            threading.Thread(target=self._serve, args=(line,), name="USB host", daemon=True).start()

    def _serve(self, line: MessageSocket) -> None:
        """Answer the calls of one process."""
        # Only this thread closes the socket. Until then no other file can get its descriptor, on
        # which this thread may be waiting.
        with contextlib.closing(line), contextlib.suppress(EOFError, OSError):
            while True:
                request: CallRequest = line.receive()
                line.send(capture_result(self._call_bus, request.name, *request.arguments))

    def _call_bus(self, name: str, *given: Any) -> Any:
        """Call a method of the bus.

        Raises OSError if the call fails, and IndexError after the end of a list.
        """
        if name not in _FORWARDED_CALLS:
            raise AttributeError(f"a backend has no {name!r}")
        try:
            return getattr(self._bus, name)(*given)
        except IndexError:
            raise
        except Exception as error:
            # The client may not be able to unpickle an exception of another class.
            raise OSError(getattr(error, "errno", None) or errno.EIO, str(error)) from error


def _message_socket(connection: Connection) -> MessageSocket:
    """Return a MessageSocket over an authenticated connection."""
    with connection:
        return MessageSocket(os.dup(connection.fileno()))


class RemoteBackend(SimulatedUsbBackend):
    """USB backend that forwards its calls to the bus of another process."""

    def __init__(self, path: str) -> None:
        self._path = path
        self._line: MessageSocket | None = None
        self._turn = threading.Lock()

    def __getattr__(self, name: str) -> Any:
        if name not in _FORWARDED_CALLS:
            raise AttributeError(f"a backend has no {name!r}")
        return lambda *given: self._ask(name, given)

    def control(self, handle: Handle, setup: SetupPacket, data: bytes, timeout: int) -> bytes:
        return bytes(self._ask("control", (handle, setup, data, timeout), timeout))

    def read(self, handle: Handle, endpoint: int, length: int, timeout: int) -> bytes:
        return bytes(self._ask("read", (handle, endpoint, length, timeout), timeout))

    def write(self, handle: Handle, endpoint: int, data: bytes, timeout: int) -> int:
        return int(self._ask("write", (handle, endpoint, data, timeout), timeout))

    def _ask(self, name: str, given: tuple[Any, ...], timeout: int = 0) -> Any:
        """Call the bus in the other process, and return its result."""
        with self._turn:
            try:
                # If the other process hasn't replied 2 s after the transfer's own timeout, it
                # counts as gone.
                answer = self._exchange(CallRequest(name, given), timeout * 1e-3 + 2.0)
            except (OSError, EOFError):
                if self._line is not None:
                    self._line.close()
                self._line = None
                # A missing process looks like a bus that was unplugged.
                if name == "enumerate_devices":
                    return []
                raise usb_error(errno.ENODEV) from None
        try:
            return answer.result()
        except OSError as error:
            raise usb_error(error.errno or errno.EIO) from None

    def _exchange(self, request: CallRequest, patience: float) -> CallResult:
        if self._line is None:
            # What another user serves could send an object that runs a program as it's unpickled.
            for file in (Path(self._path), _key_file(self._path)):
                if file.lstat().st_uid != os.getuid():
                    raise PermissionError(errno.EACCES, f"{file} is another user's")
            key = _key_file(self._path).read_bytes()
            self._line = _message_socket(Client(self._path, "AF_UNIX", authkey=key))
        self._line.send(request)
        answer: CallResult = self._line.receive(patience)
        return answer


def backend(path: str) -> RemoteBackend:
    """Return the USB backend that reaches the bus at a path.

    The drivers' option `backend` names this function.
    """
    return RemoteBackend(path)
