"""Shared memory in which the engine hands live frames over to the window.

It is the memory of the line between both. It has no name, so that nothing remains when either
process is killed, and what the window has mapped stays readable after the engine's end.
"""

from __future__ import annotations

import mmap
import os
import pickle
from dataclasses import dataclass
from typing import Any

from drivers.hosted.parcels import pack

SLOT_COUNT = 3
"""Slots for frames: one is on the screen, one is on its way there, and one is being written."""


@dataclass(frozen=True)
class SlotHeader:
    """Announce an object whose large arrays are in shared memory.

    body: the pickled object without its arrays.
    offset: where the arrays' bytes begin.
    sizes: how long each array's bytes are, one after the other.
    length: that of the whole memory.
    """

    slot: int
    body: bytes
    offset: int
    sizes: tuple[int, ...]
    length: int


class FrameMemoryWriter:
    """Write objects with large arrays into slots of the shared memory."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._memory: mmap.mmap | None = None
        self._start = self._capacity = 0

    def reserve(self, capacity: int) -> None:
        """Make slots of at least `capacity` bytes, behind those in use, which keep their place."""
        if capacity <= self._capacity:
            return
        self._start = os.fstat(self._descriptor).st_size
        length = self._start + SLOT_COUNT * capacity
        os.ftruncate(self._descriptor, length)
        self._memory, self._capacity = mmap.mmap(self._descriptor, length), capacity

    def write(self, slot: int, thing: Any) -> SlotHeader:
        """Write an object into a slot, and return its header."""
        parcel = pack(thing)
        sizes = tuple(memoryview(part).nbytes for part in parcel.buffers)
        self.reserve(sum(sizes))
        assert self._memory is not None, "reserve() has mapped the memory"
        first = offset = self._start + slot * self._capacity
        for part, size in zip(parcel.buffers, sizes, strict=True):
            self._memory[offset : offset + size] = part
            offset += size
        return SlotHeader(slot, parcel.body, first, sizes, len(self._memory))


class FrameMemoryReader:
    """Read objects from the slots of the shared memory."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = os.dup(descriptor)
        self._memory: mmap.mmap | None = None

    def close(self) -> None:
        """Close the descriptor; arrays that were read stay valid."""
        os.close(self._descriptor)

    def read(self, header: SlotHeader) -> Any:
        """Return an object from a slot; its arrays are read-only views of the shared memory.

        The views are valid until the engine writes the slot again.
        """
        if self._memory is None or len(self._memory) < header.length:
            self._memory = mmap.mmap(self._descriptor, header.length, access=mmap.ACCESS_READ)
        whole, parts, offset = memoryview(self._memory), [], header.offset
        for size in header.sizes:
            parts.append(whole[offset : offset + size])
            offset += size
        return pickle.loads(header.body, buffers=parts)
