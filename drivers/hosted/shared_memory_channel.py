"""How parcels go from one process to another: in memory that both can see."""

from __future__ import annotations

import contextlib
import mmap
from typing import NamedTuple

from drivers.hosted.message_socket import MessageSocket, hang_up_poll
from drivers.hosted.parcels import Parcel

FLAG_COUNT = 64
"""Bytes at the memory's beginning: byte i says that a call's callable i has turned true."""


class ParcelHeader(NamedTuple):
    """Says that a parcel lies in the memory: the memory's length, and its parts' in bytes."""

    length: int
    sizes: list[int]


class SharedMemoryChannel:
    """One of two ends between which parcels go: they lie in memory that both can see.

    It is the line's, which carries notes of them. Both speak in turn: a parcel is copied out
    before the next.
    """

    def __init__(self, line: MessageSocket) -> None:
        self.line, self._memory = line, mmap.mmap(line.memory, 0)

    def close(self) -> None:
        self.line.close()
        # Not while the traceback of a failed read still holds a part of it.
        with contextlib.suppress(BufferError):
            self._memory.close()

    def write(self, parcel: Parcel) -> ParcelHeader:
        parts = (parcel.body, *parcel.buffers)
        sizes = [memoryview(part).nbytes for part in parts]
        self._ensure_size(FLAG_COUNT + sum(sizes))
        offset = FLAG_COUNT
        for part, size in zip(parts, sizes, strict=True):
            self._memory[offset : offset + size] = part
            offset += size
        return ParcelHeader(len(self._memory), sizes)

    def read(self, note: ParcelHeader) -> Parcel:
        # Only here, for the system's Python, which begins with this package, too, may lack it.
        import numpy as np

        self._ensure_size(note.length)
        parts = []
        offset = FLAG_COUNT
        for size in note.sizes:
            parts.append(np.frombuffer(self._memory, np.uint8, size, offset).copy())
            offset += size
        return Parcel(parts[0], parts[1:])

    def _ensure_size(self, length: int) -> None:
        """Memory only grows: fresh memory for each picture takes longer than the picture."""
        if length > len(self._memory):
            self._memory.resize(length)

    def lower_flags(self) -> None:
        self._memory[:FLAG_COUNT] = bytes(FLAG_COUNT)

    def raise_flag(self, index: int) -> None:
        self._memory[index] = 1

    def raise_all_flags(self) -> None:
        self._memory[:FLAG_COUNT] = bytes([1]) * FLAG_COUNT

    def is_raised(self, index: int) -> bool:
        return self._memory[index] != 0

    def is_peer_closed(self) -> bool:
        """Whether the other end has been closed."""
        return bool(hang_up_poll(self.line.fileno()).poll(0))
