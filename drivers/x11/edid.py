"""Read a monitor's maker, model, serial number and size from its EDID (VESA, version 1.4)."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum

_HEADER = bytes.fromhex("00ffffffffffff00")


class _Descriptor(IntEnum):
    """Tags of the text descriptors."""

    NAME = 0xFC
    SERIAL = 0xFF


@dataclass(frozen=True)
class Monitor:
    """A monitor's maker, model and serial number; fields that it doesn't report are empty.

    maker: its three letters in the PNP registry.
    """

    maker: str = ""
    model: str = ""
    serial: str = ""


def read_edid(edid: bytes) -> Monitor:
    """Decode an EDID; the Monitor is empty for an invalid one.

    An EDID is invalid if it is too short, or if its header or checksum is wrong.
    """
    if not _is_valid(edid):
        return Monitor()
    (letters,) = struct.unpack_from(">H", edid, 8)
    maker = "".join(chr(64 + (letters >> shift & 31)) for shift in (10, 5, 0))
    product, number = struct.unpack_from("<HI", edid, 10)
    words: dict[int, str] = {
        _Descriptor.NAME: f"{maker} {product:04X}",
        _Descriptor.SERIAL: str(number or ""),
    }
    for at in (54, 72, 90, 108):
        # A descriptor that isn't a timing begins with zeros, and its text ends at a newline.
        if edid[at : at + 3] == b"\0\0\0" and edid[at + 3] in words:
            text = edid[at + 5 : at + 18].split(b"\n")[0].decode("latin-1").strip()
            words[edid[at + 3]] = text or words[edid[at + 3]]
    return Monitor(maker, words[_Descriptor.NAME], words[_Descriptor.SERIAL])


def native_size(edid: bytes) -> tuple[int, int]:
    """Return the columns and rows that a monitor has itself; zeros if it doesn't tell.

    The first timing descriptor gives them if bit 1 of the features says that it is preferred
    (version 1.3) and native (version 1.4).
    """
    features, timing = edid[24:25], edid[54:72]
    is_timing = len(timing) == 18 and timing[:2] != b"\0\0"
    if not (_is_valid(edid) and features[0] & 2 and is_timing):
        return 0, 0
    columns = timing[2] | (timing[4] & 0xF0) << 4
    rows = timing[5] | (timing[7] & 0xF0) << 4
    fields = 2 if timing[17] & 0x80 else 1
    return columns, fields * rows


def _is_valid(edid: bytes) -> bool:
    """Return whether an EDID is complete, by its length, header and checksum."""
    return len(edid) >= 128 and edid[:8] == _HEADER and not sum(edid[:128]) % 256
