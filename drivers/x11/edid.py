"""What a monitor tells of itself: the parts of VESA's EDID 1.4 that name it."""

from __future__ import annotations

import struct
from dataclasses import dataclass

_HEADER = bytes.fromhex("00ffffffffffff00")
_NAME, _SERIAL = 0xFC, 0xFF


@dataclass(frozen=True)
class Monitor:
    """Empty where the monitor doesn't say. maker: its three letters of the PNP registry."""

    maker: str = ""
    model: str = ""
    serial: str = ""


def read_edid(edid: bytes) -> Monitor:
    """An empty Monitor if these bytes are no EDID, or their check sum is wrong."""
    if len(edid) < 128 or edid[:8] != _HEADER or sum(edid[:128]) % 256:
        return Monitor()
    (letters,) = struct.unpack_from(">H", edid, 8)
    maker = "".join(chr(64 + (letters >> shift & 31)) for shift in (10, 5, 0))
    product, number = struct.unpack_from("<HI", edid, 10)
    words = {_NAME: f"{maker} {product:04X}", _SERIAL: str(number or "")}
    for at in (54, 72, 90, 108):
        # A descriptor that isn't a timing begins with zeros, and its text ends at a newline.
        if edid[at : at + 3] == b"\0\0\0" and edid[at + 3] in words:
            text = edid[at + 5 : at + 18].split(b"\n")[0].decode("latin-1").strip()
            words[edid[at + 3]] = text or words[edid[at + 3]]
    return Monitor(maker, words[_NAME], words[_SERIAL])
