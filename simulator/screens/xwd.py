"""Read screenshots in xwd's file format, whose header X11/XWDFile.h defines."""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

_HEADER = struct.Struct(">25I")


def pixels_of(dump: bytes) -> NDArray[np.uint8]:
    """Return the pixels of a virtual screen from its xwd screenshot: blue, green, red.

    The screenshot has 24 bits per pixel. The result is (rows, columns, 3).
    """
    header = _HEADER.unpack_from(dump)
    # Header fields: [0] its own size, [4] columns, [5] rows, [11] bits per pixel, [12] bytes per
    # line, and [19] entries of the colour map, of 12 bytes each.
    columns, rows, bits, line = header[4], header[5], header[11], header[12]
    begin = header[0] + 12 * header[19]
    # If the windows have several visuals, xwd packs pixels into 3 bytes and lines without padding,
    # whatever number of bytes per line the header gives.
    size = columns * bits // 8
    line = line if len(dump) - begin >= rows * line else size
    data = np.frombuffer(dump, np.uint8, rows * line, begin).reshape(rows, line)
    return data[:, :size].reshape(rows, columns, bits // 8)[..., :3]
