"""Pictures of a screen as xwd writes them, by the header's layout in X11/XWDFile.h."""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

_HEADER = struct.Struct(">25I")


def pixels_of(dump: bytes) -> NDArray[np.uint8]:
    """Of a screen of 24 bits: (rows, columns, 3), blue, green, red."""
    header = _HEADER.unpack_from(dump)
    # Its own size, columns and rows, bits a pixel, bytes a line and entries of a colour map.
    columns, rows, bits, line = header[4], header[5], header[11], header[12]
    begin = header[0] + 12 * header[19]
    # With windows of several visuals it packs pixels into 3 bytes, and lines all the same.
    size = columns * bits // 8
    line = line if len(dump) - begin >= rows * line else size
    data = np.frombuffer(dump, np.uint8, rows * line, begin).reshape(rows, line)
    return data[:, :size].reshape(rows, columns, bits // 8)[..., :3]
