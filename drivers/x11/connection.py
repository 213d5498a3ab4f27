"""Exchange requests, replies and events with an X server as bytes."""

from __future__ import annotations

import contextlib
import ctypes
import queue
import select
import struct
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

from drivers.x11 import libxcb

REPLY_TIMEOUT = 2.0
"""Seconds after which a server that doesn't answer counts as hung; chosen."""

_CONNECTION_ERRORS = {
    5: "{!r} is no name of a display, which is such as ':0'",
    6: "the X server at {!r} has no screen of that number",
}
"""Messages for XCB_CONN_CLOSED_PARSE_ERR and XCB_CONN_CLOSED_INVALID_SCREEN of xcb.h."""

_ERROR_NAMES = {
    1: "bad request",
    2: "bad value",
    3: "bad window",
    8: "bad match",
    9: "bad drawable",
    10: "access denied",
}


class XError(Exception):
    """Raised for an error that an X server reports, or if there is no server."""


class XServerGone(XError):
    """Raised if the server or the connection to it has ended for good."""


@dataclass(frozen=True)
class ServerSetup:
    """What the server tells of itself and of one of its screens on connecting.

    masks: bits of red, green and blue in a pixel. bits_per_pixel: bits that a picture takes per
    pixel, by its depth.
    """

    vendor: str
    root: int
    depth: int
    masks: tuple[int, int, int]
    bits_per_pixel: dict[int, int]
    little_endian: bool


class XConnection:
    """Connection to an X server, for requests and events.

    Parameters
    ----------
    display : str
        The X server, as in DISPLAY, such as ":0" or ":0.1".

    Raises
    ------
    XError
        If libxcb isn't installed, there is no such server, or it doesn't answer in time.
    """

    def __init__(self, display: str) -> None:
        self.display = display
        try:
            xcb = libxcb.load_library()
        except OSError as error:
            raise XError("libxcb isn't installed (Debian: libxcb1)") from error
        screen = ctypes.c_int(0)
        self._at: int | None = _connect(display, screen)
        if refusal := xcb.xcb_connection_has_error(self._at):
            self.close()
            raise XError(
                _CONNECTION_ERRORS.get(refusal, "no X server answers at {!r}").format(display)
            )
        self._opcodes: dict[str, tuple[int, int]] = {}
        self._lock = threading.RLock()
        try:
            self.setup = _read_setup(xcb.xcb_get_setup(self._at), screen.value)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        if self._at is not None:
            libxcb.load_library().xcb_disconnect(self._at)
            self._at = None

    def fileno(self) -> int:
        """Return the file descriptor that becomes readable when events arrive."""
        return int(libxcb.load_library().xcb_get_file_descriptor(self._require_open()))

    def new_id(self) -> int:
        return int(libxcb.load_library().xcb_generate_id(self._require_open()))

    def send_request(self, opcode: int, body: bytes) -> None:
        """Send a request without reply; its errors arrive among the events."""
        with self._lock:
            if not libxcb.send(self._require_open(), opcode, body, has_reply=False):
                raise self._gone_error()
            libxcb.load_library().xcb_flush(self._require_open())

    def query(self, opcode: int, body: bytes) -> bytes:
        """Send a request and return the reply.

        body: the request from its opcode on; its length is filled in.
        """
        with self._lock:
            return self._query_unlocked(self._require_open(), opcode, body)

    def _query_unlocked(self, at: int, opcode: int, body: bytes) -> bytes:
        sequence = libxcb.send(at, opcode, body, has_reply=True)
        if not sequence:
            raise self._gone_error()
        libxcb.load_library().xcb_flush(at)
        late = time.monotonic() + REPLY_TIMEOUT
        while True:
            done, reply, error = libxcb.reply_or_error(at, sequence)
            if error:
                words = _ERROR_NAMES.get(error, f"error {error}")
                raise XError(f"{self.display} refuses request {opcode}.{body[1]}: {words}")
            if done and reply:
                return reply
            if done or libxcb.load_library().xcb_connection_has_error(at):
                raise self._gone_error()
            left = late - time.monotonic()
            if left <= 0:
                raise XError(f"the X server {self.display} doesn't answer")
            readable = select.poll()
            readable.register(self.fileno(), select.POLLIN)
            readable.poll(left * 1e3)

    def events(self) -> Iterator[bytes]:
        """Yield the events that have arrived, without waiting; XError if the server has ended."""
        while (event := libxcb.next_event(self._require_open())) is not None:
            yield event
        if libxcb.load_library().xcb_connection_has_error(self._require_open()):
            raise self._gone_error()

    def extension(self, name: str) -> tuple[int, int]:
        """Return an extension's major opcode and first event; XError if the server lacks it."""
        if name not in self._opcodes:
            word = name.encode()
            reply = self.query(98, struct.pack("<BxHHxx", 98, 0, len(word)) + word)
            if not reply[8]:
                raise XError(f"the X server {self.display} has no {name} extension")
            self._opcodes[name] = (reply[9], reply[10])
        return self._opcodes[name]

    def has(self, name: str) -> bool:
        try:
            self.extension(name)
        except XError:
            return False
        return True

    def query_extension(
        self, name: str, minor: int, layout: str = "", *values: int | bytes
    ) -> bytes:
        """Send an extension's request and return the reply."""
        major, _ = self.extension(name)
        return self.query(major, struct.pack("<BBH" + layout, major, minor, 0, *values))

    def send_extension_request(
        self, name: str, minor: int, layout: str = "", *values: int | bytes
    ) -> None:
        """Send an extension's request that has no reply."""
        major, _ = self.extension(name)
        self.send_request(major, struct.pack("<BBH" + layout, major, minor, 0, *values))

    def atom(self, name: str) -> int:
        """Return the server's number of the atom of that name."""
        word = name.encode()
        reply = self.query(16, struct.pack("<BBHHxx", 16, 0, 0, len(word)) + word)
        return int(struct.unpack_from("<I", reply, 8)[0])

    def _require_open(self) -> int:
        if self._at is None:
            raise XError(f"the connection to {self.display} is closed")
        return self._at

    def _gone_error(self) -> XServerGone:
        return XServerGone(f"the X server {self.display} has gone")


def _connect(display: str, screen: ctypes.c_int) -> int:
    """Return libxcb's connection, usable or failed; XError without an answer."""
    made: queue.SimpleQueue[int] = queue.SimpleQueue()
    unwanted = threading.Event()

    def forget() -> None:
        """Close a connection that came too late; either thread may do this."""
        with contextlib.suppress(queue.Empty):
            libxcb.load_library().xcb_disconnect(made.get_nowait())

    def connect() -> None:
        made.put(libxcb.load_library().xcb_connect(display.encode(), ctypes.byref(screen)))
        if unwanted.is_set():
            forget()

    # libxcb waits for the server without a timeout, so it is called in a separate thread.
    threading.Thread(target=connect, name=f"connect to {display}", daemon=True).start()
    try:
        return made.get(timeout=REPLY_TIMEOUT)
    except queue.Empty:
        unwanted.set()
        forget()
        raise XError(f"the X server {display} doesn't answer") from None


def _read_setup(address: int, number: int) -> ServerSetup:
    """Decode the setup; see "Connection Setup" of the protocol."""
    words = struct.unpack("<H", ctypes.string_at(address + 6, 2))[0]
    told = ctypes.string_at(address, 8 + 4 * words)
    vendor_length, formats, order = struct.unpack_from("<H3xBB", told, 24)
    vendor = told[40 : 40 + vendor_length].decode("latin-1")
    at = 40 + vendor_length + -vendor_length % 4
    bits = {told[at + 8 * i]: told[at + 8 * i + 1] for i in range(formats)}
    at += 8 * formats
    for _ in range(number):
        at = _parse_screen(told, at)[0]
    visuals = _parse_screen(told, at)[1]
    root, visual = struct.unpack_from("<I28xI", told, at)
    return ServerSetup(vendor, root, told[at + 38], visuals.get(visual, (0, 0, 0)), bits, not order)


def _parse_screen(told: bytes, at: int) -> tuple[int, dict[int, tuple[int, int, int]]]:
    """Return the offset of the next screen in the setup, and this screen's masks.

    The masks are the red, green and blue masks of each visual, by the visual's number.
    """
    masks = {}
    depths, at = told[at + 39], at + 40
    for _ in range(depths):
        (count,) = struct.unpack_from("<H", told, at + 2)
        at += 8
        for _ in range(count):
            visual, red, green, blue = struct.unpack_from("<I4xIII", told, at)
            masks[visual] = (red, green, blue)
            at += 24
    return at, masks
