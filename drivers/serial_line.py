"""Serial ports on which a read ends in time or raises a DeviceError that says what came."""

from __future__ import annotations

import contextlib
import errno
import os
import re
import threading
from collections.abc import Callable, Iterator
from typing import Any

from drivers.device_holders import name_holders
from drivers.errors import DeviceError
from drivers.interfaces import Clock

_MAX_REPLY_BYTES = 65536
"""Bytes in one reply above which a device counts as sending without end."""

_CABLE = "Check the cable, the power and that the port is the device's"

_DISCONNECTED = ("it is disconnected", "Plug the device in again")
_FORBIDDEN = (
    "this user may not use it",
    "Add yourself to the group dialout (sudo adduser NAME dialout), and log in again",
)
_PORT_BUSY = ("another program uses it", "Close the other program that uses the port")
_CLOSE_FIRST = "Close that first"
_NO_PORT = ("it is no serial port", "Look up the device's port by: labapp devices")

_ERRNO_EXPLANATIONS = {
    errno.ENOENT: (
        "there is no such port",
        "Plug the device in, switch it on, and look up its port by: labapp devices",
    ),
    errno.EACCES: _FORBIDDEN,
    errno.EPERM: _FORBIDDEN,
    errno.EBUSY: _PORT_BUSY,
    errno.EAGAIN: _PORT_BUSY,
    errno.ENXIO: _DISCONNECTED,
    errno.ENODEV: _DISCONNECTED,
    errno.EIO: _DISCONNECTED,
    errno.ENOTTY: _NO_PORT,
    errno.EISDIR: _NO_PORT,
    errno.ECONNREFUSED: (
        "nobody serves it there",
        "Start the program that serves it, or correct host and number in the option port",
    ),
}
"""Meaning and remedy of a port's errors, by errno."""


def port_errors() -> tuple[type[BaseException], ...]:
    """Return the exception classes that a port may raise on this system."""
    import serial

    errors: tuple[type[BaseException], ...] = (serial.SerialException, OSError, ValueError)
    try:
        import termios
    except ImportError:
        return errors
    return (*errors, termios.error)


_NETWORK_PORT = re.compile(r"(socket|rfc2217)://[^/?#\s]+:\d{1,5}/?|sim://[\w.-]+", re.IGNORECASE)
"""Servers of serial ports; sim:// is a simulated line of this process."""

_PSEUDO_TERMINALS = range(136, 144)
"""Major device numbers of pseudo-terminals, from Linux' devices.txt."""

_LOCAL_PORT = re.compile(r"/[^\0]*|COM\d+", re.IGNORECASE)


def require_port(port: object) -> None:
    """Raise ValueError unless the text of the option `port` may be opened.

    Other URLs of pyserial do more than that: spy:// writes a file that its text names.
    """
    if isinstance(port, str) and (_LOCAL_PORT.fullmatch(port) or _NETWORK_PORT.fullmatch(port)):
        return
    raise ValueError(
        f'port is {port!r}; give a device path such as "/dev/ttyUSB0", or '
        '"socket://HOST:NUMBER", or "rfc2217://HOST:NUMBER"'
    )


class SerialLine:
    """One device's port, with timeouts by the bench's clock.

    model: the device's name in errors. url: a port ("/dev/ttyUSB0", "COM3"), or what serves one in
    the network ("socket://host:port", "rfc2217://host:port"); see require_port(). baudrate: bits
    per second. rtscts: whether hardware flow control is used.

    Every failure is a DeviceError. A port that fails is closed; the next write opens it again. The
    driver sets `in_sync` once the device is at rest. Opening and every failure set it to False,
    because an old reply may then still arrive.
    """

    def __init__(
        self, model: str, url: str, clock: Clock, *, baudrate: int, rtscts: bool = False
    ) -> None:
        require_port(url)
        self.model, self.url, self.clock = model, url, clock
        self.in_sync = False
        self._baudrate, self._rtscts = baudrate, rtscts
        self._port: Any = None
        self._errors: tuple[type[BaseException], ...] = ()
        self._buffer = bytearray()
        self._until = float("inf")
        self._cancelled = threading.Event()

    @property
    def is_open(self) -> bool:
        return self._port is not None

    @property
    def is_cancelled(self) -> bool:
        """Whether cancel() was called, after which the line can't be used any more."""
        return self._cancelled.is_set()

    @property
    def time_left(self) -> float:
        """Seconds until the limit set by within(); infinite outside of it."""
        return self._until - self.clock.now()

    def open(self, command: str = "open") -> None:
        """Open the port for exclusive use, unless it is open already."""
        if self._port is not None:
            return
        self._require_not_cancelled(command)
        import serial

        self._errors = port_errors()
        self.in_sync = False
        self._buffer.clear()
        # Flow control may hold up a write for 1 s. pyserial's RFC 2217 has no write timeout.
        writing = None if self.url.lower().startswith("rfc2217:") else 1.0
        try:
            self._port = serial.serial_for_url(
                self.url,
                baudrate=self._baudrate,
                timeout=0,
                write_timeout=writing,
                rtscts=self._rtscts,
                exclusive=True,
            )
        except self._errors as error:
            raise self._close_with_error(command, error) from error
        self._take_alone(command)

    def _take_alone(self, command: str) -> None:
        """Keep other programs from the port; DeviceError if one has it open.

        pyserial has locked the port by flock(2), which not all programs heed.
        """
        if not os.path.isabs(self.url):
            return
        if who := name_holders(self.url):
            self.close()
            raise self.error(command, f"port {self.url}: it is in use by {who}", _CLOSE_FIRST)
        with contextlib.suppress(*self._errors):
            handle = self._port.fileno()
            # A pseudo-terminal would stay closed to all after its program was killed.
            if os.major(os.fstat(handle).st_rdev) not in _PSEUDO_TERMINALS:
                _forbid_others(handle)

    def unplugged_reason(self) -> str | None:
        """Return why the device counts as unplugged; empty while its port exists.

        It looks only for the port's file and sends nothing; it returns None for a port that isn't
        a file. Any thread may call it.
        """
        if not os.path.isabs(self.url):
            return None
        return "" if os.path.exists(self.url) else f"port {self.url} isn't there any more"

    def close(self) -> None:
        """Close the port; this never raises."""
        port, self._port = self._port, None
        self.in_sync = False
        self._buffer.clear()
        if port is not None:
            with contextlib.suppress(*self._errors):
                port.close()

    def reopen(self, command: str = "open again") -> None:
        """Close the port, and open it again."""
        self.close()
        self.open(command)

    def cancel(self) -> None:
        """End the present read and all later ones; from any thread."""
        self._cancelled.set()
        port = self._port
        if port is not None and hasattr(port, "cancel_read"):
            with contextlib.suppress(Exception):
                port.cancel_read()

    @contextlib.contextmanager
    def within(self, seconds: float) -> Iterator[None]:
        """Limit the total time of all reads in this context, whatever their own timeouts are."""
        before = self._until
        self._until = min(before, self.clock.now() + seconds)
        try:
            yield
        finally:
            self._until = before

    def write(self, data: bytes, command: str) -> None:
        """Send bytes; a closed port is opened first."""
        self.open(command)
        try:
            self._port.write(data)
        except self._errors as error:
            raise self._close_with_error(command, error) from error

    def read(self, count: int, command: str, seconds: float) -> bytes:
        """Read exactly `count` bytes within `seconds`."""
        return self._read_bytes(lambda held: count if len(held) >= count else 0, command, seconds)

    def read_until(self, end: bytes, command: str, seconds: float) -> bytes:
        """Read up to and including `end`, within `seconds`."""

        def length(held: bytearray) -> int:
            found = held.find(end)
            return found + len(end) if found >= 0 else 0

        return self._read_bytes(length, command, seconds)

    def has_received(self, end: bytes, command: str, seconds: float) -> bool:
        """Return whether an `end` has arrived within `seconds`.

        Raises DeviceError when the time of within() is over.
        """
        late = self.clock.now() + seconds
        while end not in self._buffer:
            if (now := self.clock.now()) >= self._until:
                raise self.error(command, "no reply in time")
            left = min(late, self._until) - now
            piece = self._read_available(command, left) if left > 0 else b""
            if not piece:
                return False
            self._buffer += piece
        return True

    def drain(self, quiet: float, timeout: float, command: str = "come to rest") -> bytes:
        """Discard bytes until none comes for `quiet` seconds; return them."""
        self.open(command)
        gone, self._buffer = bytes(self._buffer), bytearray()
        late = min(self.clock.now() + timeout, self._until)
        while piece := self._read_available(command, quiet):
            gone += piece
            if self.clock.now() > late or len(gone) > _MAX_REPLY_BYTES:
                raise self.error(
                    command,
                    f"it doesn't stop talking: {_preview(gone)}",
                    "Check port and baud rate; switch the device off and on",
                )
        return gone

    def error(self, command: str, reply: str, remedy: str = _CABLE) -> DeviceError:
        """Make a DeviceError, and mark the line as not in sync."""
        self.in_sync = False
        return DeviceError(self.model, command, reply, remedy)

    def _read_bytes(
        self, length: Callable[[bytearray], int], command: str, seconds: float
    ) -> bytes:
        """Read bytes until they form a reply.

        length: function from the bytes so far to the length of the reply in them, 0 if it isn't
        complete.
        """
        if self._port is None:
            raise self.error(command, "the port is closed", "Try again: it is opened again")
        granted = max(0.0, min(seconds, self.time_left))
        late = self.clock.now() + granted
        while not (found := length(self._buffer)):
            left = late - self.clock.now()
            piece = self._read_available(command, left) if left > 0 else b""
            if not piece:
                came = f"it broke off after {_preview(self._buffer)}: no more"
                said = f"{came if self._buffer else 'no reply'} within {granted:.3g} s"
                raise self.error(command, said)
            self._buffer += piece
            if len(self._buffer) > _MAX_REPLY_BYTES:
                came = f"it doesn't stop talking: {_preview(self._buffer)}"
                raise self.error(command, came, "Check port and baud rate")
        taken = bytes(self._buffer[:found])
        del self._buffer[:found]
        return taken

    def _read_available(self, command: str, seconds: float) -> bytes:
        """Return the next bytes, or none if none come within `seconds`."""
        self._require_not_cancelled(command)
        try:
            self._port.timeout = seconds
            piece: bytes = self._port.read(max(1, min(self._port.in_waiting, 4096)))
        except self._errors as error:
            raise self._close_with_error(command, error) from error
        # A read that was cancelled must not be reported as a device that doesn't answer.
        self._require_not_cancelled(command)
        return piece

    def _require_not_cancelled(self, command: str) -> None:
        """Raise DeviceError if cancel() was called."""
        if self._cancelled.is_set():
            raise self.error(command, "the device was given up", "Open the device again")

    def _close_with_error(self, command: str, error: BaseException) -> DeviceError:
        """Close a port that has failed, and return the DeviceError for it."""
        self.close()
        reply, remedy = _explain_port_error(error)
        if (reply, remedy) == _PORT_BUSY and (who := name_holders(self.url)):
            reply, remedy = f"it is in use by {who}", _CLOSE_FIRST
        return self.error(command, f"port {self.url}: {reply}", remedy)


def _forbid_others(handle: int) -> None:
    """Have the system refuse the port to other programs until it was closed.

    Root is let in nevertheless, and whoever has it open already stays.
    """
    import fcntl
    import termios

    fcntl.ioctl(handle, termios.TIOCEXCL)


def _explain_port_error(error: BaseException) -> tuple[str, str]:
    """Return what a port's exception means, and its remedy."""
    number = _errno_of(error)
    if number in _ERRNO_EXPLANATIONS:
        return _ERRNO_EXPLANATIONS[number]
    # pyserial writes this when a port reports data but then has none.
    if "returned no data" in str(error):
        return _DISCONNECTED
    if "Write timeout" in str(error):
        return "it takes no more bytes: the other side holds it up", _CABLE
    if isinstance(error, ValueError):
        return str(error), "Correct the option port"
    return str(error), _CABLE


def _errno_of(error: BaseException | None) -> int:
    """Return the errno of an exception, or of one that it came from; 0 without one."""
    while error is not None:
        for number in (getattr(error, "errno", None), *error.args[:1]):
            if isinstance(number, int):
                return number
        error = error.__context__
    return 0


def _preview(data: bytes | bytearray) -> str:
    """Format bytes for an error message, cut to about a line."""
    shown = bytes(data[:60])
    return f"{shown!r}" + (f" and {len(data) - 60} bytes more" if len(data) > 60 else "")
