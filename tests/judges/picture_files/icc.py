"""ICC profiles of matrix and curve, or of one grey curve, written from ICC.1:2001-04."""

from __future__ import annotations

import struct

import numpy as np

SRGB_COLUMNS = ((0.4361, 0.2225, 0.0139), (0.3851, 0.7169, 0.0971), (0.1431, 0.0606, 0.7141))
PROPHOTO_COLUMNS = ((0.7977, 0.2880, 0.0), (0.1352, 0.7119, 0.0), (0.0313, 0.0001, 0.8249))
"""XYZ of red, green and blue under D50."""

_WHITE = (0.9642, 1.0, 0.8249)


def icc_profile(
    curve: float | str, columns: tuple[tuple[float, float, float], ...] = SRGB_COLUMNS
) -> bytes:
    """A display's profile; curve: an exponent, "srgb" for a table, "parametric" for v4's sRGB."""
    tags = [(b"wtpt", _xyz(_WHITE))]
    tags += [(name, _xyz(c)) for name, c in zip((b"rXYZ", b"gXYZ", b"bXYZ"), columns, strict=True)]
    tags += [(name, _curve(curve)) for name in (b"rTRC", b"gTRC", b"bTRC")]
    return _profile(b"RGB ", tags, 4 if curve == "parametric" else 2)


def grey_profile(curve: float | str) -> bytes:
    """A profile of one grey channel."""
    return _profile(b"GRAY", [(b"wtpt", _xyz(_WHITE)), (b"kTRC", _curve(curve))], 2)


def _profile(space: bytes, tags: list[tuple[bytes, bytes]], version: int) -> bytes:
    tags = [(b"desc", _description()), (b"cprt", b"text\0\0\0\0free\0"), *tags]
    table, body = struct.pack(">I", len(tags)), b""
    begin = 128 + 4 + 12 * len(tags)
    for name, data in tags:
        table += name + struct.pack(">II", begin + len(body), len(data))
        body += data + bytes(-len(data) % 4)
    whole = 128 + len(table) + len(body)
    head = struct.pack(">I4sI4s4s4s", whole, b"\0\0\0\0", version << 24, b"mntr", space, b"XYZ ")
    head += struct.pack(">6H", 2024, 1, 1, 0, 0, 0) + b"acsp" + bytes(28)
    head += b"".join(struct.pack(">i", round(v * 65536)) for v in _WHITE)
    return head.ljust(128, b"\0") + table + body


def _description() -> bytes:
    text = b"made by hand\0"
    return b"desc\0\0\0\0" + struct.pack(">I", len(text)) + text + bytes(78)


def _xyz(values: tuple[float, float, float]) -> bytes:
    return b"XYZ \0\0\0\0" + struct.pack(">3i", *(round(v * 65536) for v in values))


def _curve(curve: float | str) -> bytes:
    if curve == "parametric":
        numbers = (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)
        return b"para\0\0\0\0\0\3\0\0" + struct.pack(">5i", *(round(v * 65536) for v in numbers))
    if curve == "srgb":
        v = np.linspace(0, 1, 1024)
        light = np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)
        table = np.rint(light * 65535).astype(">u2")
        return b"curv\0\0\0\0" + struct.pack(">I", len(table)) + table.tobytes()
    if curve == 1:
        return b"curv\0\0\0\0" + struct.pack(">I", 0)
    return b"curv\0\0\0\0" + struct.pack(">IH", 1, round(float(curve) * 256))
