"""Find datasets in an HDF5 file whose links are cut off, by their object headers.

HDF5 writes the names of many objects at the end of a file, and a truncated file has lost them. The
header of each object stands near its beginning, and tells type, shape and place. See the HDF5 File
Format Specification, version 3.0, IV.A.1.b (headers), IV.A.2.b (dataspace), d (datatype), i
(layout).
"""

from __future__ import annotations

import math
import mmap
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

_SIGNATURE = b"OHDR\x02"

_DATASPACE, _DATATYPE, _LAYOUT = 1, 3, 8
"""Kinds of messages."""

_TIMES, _PHASES, _ORDERED = 0x20, 0x10, 0x04
"""Bits of a header: it has times, limits of its attributes, numbers of its messages."""

_CONTIGUOUS = 1
_UNDEFINED = (1 << 64) - 1

_ENCODED_TYPE = b"\x03\x00"
"""What H5Tencode() writes before a datatype: the kind of message and a version."""

_MOST_AXES = 3


@dataclass(frozen=True)
class HeadedDataset:
    """A dataset that its header tells.

    header: where that begins, bytes.
    offset: of its data, bytes; None if it isn't told.
    """

    header: int
    shape: tuple[int, ...]
    dtype: np.dtype
    offset: int | None

    def read(self, data: bytes | mmap.mmap) -> NDArray[Any]:
        """Read the values from the bytes of the file; raise ValueError if they end before."""
        size = math.prod(self.shape) * self.dtype.itemsize
        part = data[self.offset : self.offset + size] if self.offset is not None else b""
        return np.frombuffer(part, self.dtype).reshape(self.shape)


def find_headed_datasets(data: bytes | mmap.mmap) -> Iterator[HeadedDataset]:
    """Yield the contiguous datasets whose headers are in the first bytes of a file.

    They come in the order of their headers, which is that in which they were made.
    """
    for match in re.finditer(_SIGNATURE, data):
        found = _read_header(data, match.start())
        if found is not None:
            yield found


def _read_header(data: bytes | mmap.mmap, start: int) -> HeadedDataset | None:
    """Return the dataset whose header begins there; None if it isn't the header of one."""
    try:
        messages = dict(_messages(data, start))
        shape = _shape(messages[_DATASPACE])
        dtype = h5py.h5t.decode(_ENCODED_TYPE + messages[_DATATYPE]).dtype
        offset = _offset(messages[_LAYOUT]) if _LAYOUT in messages else None
    except (KeyError, ValueError, TypeError, RuntimeError, struct.error, IndexError):
        return None
    return HeadedDataset(start, shape, np.dtype(dtype), offset)


def _messages(data: bytes | mmap.mmap, start: int) -> Iterator[tuple[int, bytes]]:
    """Yield kind and content of the messages in the first part of an object's header."""
    flags = data[start + 5]
    at = start + 6 + 16 * bool(flags & _TIMES) + 4 * bool(flags & _PHASES)
    width = 1 << (flags & 3)
    size = int.from_bytes(data[at : at + width], "little")
    at += width
    end = min(at + size, len(data))
    head = 6 if flags & _ORDERED else 4
    while at + head <= end:
        kind, length = data[at], int.from_bytes(data[at + 1 : at + 3], "little")
        yield kind, data[at + head : at + head + length]
        at += head + length


def _shape(message: bytes) -> tuple[int, ...]:
    """Return the shape that a dataspace message of version 2 tells."""
    version, axes = message[0], message[1]
    if version != 2 or axes > _MOST_AXES:
        raise ValueError("not a dataspace of a record")
    return struct.unpack_from(f"<{axes}Q", message, 4)


def _offset(message: bytes) -> int:
    """Return the position that a layout message of version 3 or 4 tells of data in one piece."""
    version, kind, offset = struct.unpack_from("<BBQ", message)
    if version not in (3, 4) or kind != _CONTIGUOUS or offset == _UNDEFINED:
        raise ValueError("not data in one piece")
    return offset
