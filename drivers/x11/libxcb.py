"""Call libxcb, the X11 client library, through ctypes."""

from __future__ import annotations

import ctypes
import functools
import struct
from ctypes import POINTER, byref, c_char_p, c_int, c_size_t, c_ubyte, c_uint, c_uint32, c_void_p
from typing import Any


class ProtocolRequest(ctypes.Structure):
    """The library's xcb_protocol_request_t; without `ext`, `opcode` is the major opcode."""

    _fields_ = (
        ("count", c_size_t),
        ("ext", c_void_p),
        ("opcode", c_ubyte),
        ("isvoid", c_ubyte),
    )


class IoVector(ctypes.Structure):
    """C's struct iovec, in which the bytes of a request are passed."""

    _fields_ = (("base", c_void_p), ("length", c_size_t))


GENERIC_EVENT = 35
"""Code of X11's GenericEvent, which extensions use for events of their own."""


@functools.cache
def load_library() -> Any:
    """Load libxcb and declare its functions; OSError if it isn't installed."""
    xcb = ctypes.CDLL("libxcb.so.1")
    for name, result, given in (
        ("xcb_connect", c_void_p, (c_char_p, POINTER(c_int))),
        ("xcb_connection_has_error", c_int, (c_void_p,)),
        ("xcb_disconnect", None, (c_void_p,)),
        ("xcb_get_file_descriptor", c_int, (c_void_p,)),
        ("xcb_get_setup", c_void_p, (c_void_p,)),
        ("xcb_generate_id", c_uint32, (c_void_p,)),
        ("xcb_send_request", c_uint, (c_void_p, c_int, c_void_p, c_void_p)),
        ("xcb_flush", c_int, (c_void_p,)),
        ("xcb_poll_for_reply", c_int, (c_void_p, c_uint, POINTER(c_void_p), POINTER(c_void_p))),
        ("xcb_wait_for_reply", c_void_p, (c_void_p, c_uint, POINTER(c_void_p))),
        ("xcb_poll_for_event", c_void_p, (c_void_p,)),
    ):
        function = getattr(xcb, name)
        function.restype, function.argtypes = result, given
    return xcb


@functools.cache
def _free() -> Any:
    free = ctypes.CDLL(None).free
    free.restype, free.argtypes = None, (c_void_p,)
    return free


def copy_and_free(address: int, length: int) -> bytes:
    """Copy memory that the library allocated, and free it."""
    try:
        return ctypes.string_at(address, length)
    finally:
        _free()(address)


def send(connection: int, opcode: int, body: bytes, has_reply: bool) -> int:
    """Send a request; return its sequence number, or 0 on failure.

    The request's length is filled in.
    """
    padded = ctypes.create_string_buffer(body + bytes(-len(body) % 4))
    # libxcb uses two vectors in front of the first one itself.
    vectors = (IoVector * 3)()
    vectors[2] = IoVector(ctypes.cast(padded, c_void_p), len(body) + -len(body) % 4)
    protocol = ProtocolRequest(1, None, opcode, not has_reply)
    where = ctypes.addressof(vectors) + 2 * ctypes.sizeof(IoVector)
    # With XCB_REQUEST_CHECKED, an error comes with the reply and not among the events.
    checked = 1
    return int(
        load_library().xcb_send_request(connection, checked * has_reply, where, byref(protocol))
    )


def reply_or_error(connection: int, sequence: int) -> tuple[bool, bytes, int]:
    """Return whether a request is done, its reply, and its error code or 0."""
    reply, error = c_void_p(), c_void_p()
    done = load_library().xcb_poll_for_reply(connection, sequence, byref(reply), byref(error))
    if error.value:
        return True, b"", copy_and_free(error.value, 32)[1]
    if not reply.value:
        return bool(done), b"", 0
    length = 32 + 4 * c_uint32.from_address(reply.value + 4).value
    return True, copy_and_free(reply.value, length), 0


def round_trip(connection: int) -> None:
    """Wait until the server has processed everything that was sent on this connection."""
    get_input_focus = 43
    sequence = send(connection, get_input_focus, struct.pack("<BxH", get_input_focus, 0), True)
    error = c_void_p()
    reply = load_library().xcb_wait_for_reply(connection, sequence, byref(error))
    for answer in (reply, error.value):
        if answer:
            copy_and_free(answer, 32)


def next_event(connection: int) -> bytes | None:
    """Return the next event that has arrived, without waiting; None without one."""
    event = load_library().xcb_poll_for_event(connection)
    if not event:
        return None
    # libxcb appends the full sequence number after the first 32 bytes.
    length = 36
    # Generic events may be longer.
    if ctypes.string_at(event, 1)[0] & 0x7F == GENERIC_EVENT:
        length += 4 * c_uint32.from_address(event + 4).value
    return copy_and_free(event, length)
