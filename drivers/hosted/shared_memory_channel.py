"""Pass parcels between a process and its child through shared memory."""

from __future__ import annotations

import contextlib
import mmap
from typing import NamedTuple

from drivers.hosted.message_socket import MessageSocket, hang_up_poll
from drivers.hosted.parcels import Parcel

FLAG_COUNT = 64
"""Flag bytes at the memory's beginning. Byte i is set when callable i of a call becomes true."""


class ParcelHeader(NamedTuple):
    """Announces a parcel in shared memory: the memory's length, and the parts' sizes in bytes."""

    length: int
    sizes: list[int]


class SharedMemoryChannel:
    """One end of a channel that passes parcels between processes through shared memory.

    The memory belongs to the line, on which headers announce the parcels. The ends send in turn: a
    parcel is copied out of the memory before the next one is written.
    """

    def __init__(self, line: MessageSocket) -> None:
        self.line, self._memory = line, mmap.mmap(line.memory, 0)

    def close(self) -> None:
        self.line.close()
        # The traceback of a failed read may still hold a view of the memory.
        with contextlib.suppress(BufferError):
            self._memory.close()

    def write(self, parcel: Parcel) -> ParcelHeader:
        """Write a parcel to the memory."""
        parts = (parcel.body, *parcel.buffers)
        sizes = [memoryview(part).nbytes for part in parts]
        self._ensure_size(FLAG_COUNT + sum(sizes))
        offset = FLAG_COUNT
        for part, size in zip(parts, sizes, strict=True):
            self._memory[offset : offset + size] = part
            offset += size
        return ParcelHeader(len(self._memory), sizes)

    def read(self, note: ParcelHeader) -> Parcel:
        """Copy a parcel out of the memory; its header gives the sizes."""
        # NumPy is imported late, because the system's Python, which also loads this package, may
        # not have it.
        import numpy as np

        self._ensure_size(note.length)
        parts = []
        offset = FLAG_COUNT
        for size in note.sizes:
            parts.append(np.frombuffer(self._memory, np.uint8, size, offset).copy())
            offset += size
        return Parcel(parts[0], parts[1:])

    def _ensure_size(self, length: int) -> None:
        """Enlarge the memory if needed; it never shrinks.

        Fresh memory for each picture would take longer than copying the picture.
        """
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
        """Return whether the other process has closed its end."""
        return bool(hang_up_poll(self.line.fileno()).poll(0))
