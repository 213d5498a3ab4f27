"""Receive frames in memory that is shared with the parent process."""

from __future__ import annotations

import contextlib
import ctypes
import mmap
import os
import time
from typing import Any

from .camera_control import CameraControl
from .features import region_list


class FrameStream:
    """Stream frames of an open camera into shared memory. memory: its file descriptor."""

    def __init__(self, owner: CameraControl, memory: int) -> None:
        self._owner, self._memory = owner, memory
        self._stream: Any = None
        self._slots: dict[int, int] = {}
        self._buffers: dict[int, Any] = {}
        self._totals: dict[str, int] = {}
        self._parser: Any = None
        self._mapped: mmap.mmap | None = None
        self._size = ctypes.CDLL("libaravis-0.8.so.0").arv_buffer_get_data
        self._size.restype = ctypes.c_void_p
        self._size.argtypes = [ctypes.c_void_p, ctypes.POINTER(ctypes.c_size_t)]

    def set_chunks(self) -> bool:
        """Have the camera report each frame's exposure; return whether it will."""
        try:
            self._owner.camera.set_chunks("ExposureTime")
            self._parser = self._owner.camera.create_chunk_parser()
        except Exception:
            self._parser = None
        return self._parser is not None

    def start(self, buffers: int) -> dict[str, int]:
        """Start a stream on a new port, so that frames in transit never reach it."""
        self.stop()
        size = int(self._owner.camera.get_payload())
        slot = -(-size // mmap.PAGESIZE) * mmap.PAGESIZE
        if self._mapped is None or len(self._mapped) != slot * buffers:
            os.ftruncate(self._memory, slot * buffers)
            self._mapped = mmap.mmap(self._memory, slot * buffers)
        base = ctypes.addressof(ctypes.c_char.from_buffer(self._mapped))
        self._stream = self._owner.camera.create_stream(None, None)
        if self._stream is None:
            raise RuntimeError("no stream could be made")
        if self._owner.camera.is_gv_device():
            self._stream.set_property("frame-retention", 100_000)
        for number in range(buffers):
            buffer = self._owner.aravis.Buffer.new(size, base + number * slot)
            self._slots[hash(buffer)] = number * slot
            self._buffers[number * slot] = buffer
            self._stream.push_buffer(buffer)
        self._owner.camera.set_acquisition_mode(self._owner.aravis.AcquisitionMode.CONTINUOUS)
        self._owner.camera.start_acquisition()
        return {"size": size, "slot": slot, "length": slot * buffers}

    def stop(self) -> None:
        if self._stream is None:
            return
        try:
            self._owner.camera.stop_acquisition()
        finally:
            self._totals = self.counts()
            self._stream = None
            self._slots.clear()
            self._buffers.clear()

    def trigger(self) -> float:
        """Trigger a frame by software; return the time.monotonic() just before."""
        began = time.monotonic()
        self._owner.camera.software_trigger()
        return began

    def drain(self) -> list[int]:
        """Discard the frames that wait in the queue; return their numbers."""
        ids = []
        while (buffer := self._stream.try_pop_buffer()) is not None:
            ids.append(buffer.get_frame_id())
            self._stream.push_buffer(buffer)
        return ids

    def pop(self, seconds: float, back: int = -1) -> dict[str, Any] | None:
        """Return a note on the next frame; None if none comes in time.

        back: the place of a frame that was read, whose buffer is returned to the stream.
        """
        if back >= 0:
            self._stream.push_buffer(self._buffers[back])
        buffer = self._stream.timeout_pop_buffer(int(seconds * 1e6))
        if buffer is None:
            return None
        now, real = time.monotonic(), time.time_ns()
        status = self._owner.aravis.BufferStatus(buffer.get_status()).value_nick
        note: dict[str, Any] = {
            "status": status,
            "place": self._slots[hash(buffer)],
            "number": buffer.get_frame_id(),
            "arrived": now - (real - buffer.get_system_timestamp()) * 1e-9,
            "stamp": buffer.get_timestamp(),
        }
        if status == "success":
            size = ctypes.c_size_t()
            self._size(hash(buffer), ctypes.byref(size))
            note["size"] = size.value
            note["code"] = buffer.get_image_pixel_format() & 0xFFFFFFFF
            note["region"] = region_list(buffer.get_image_region())
            note["padding"], note["chunks"] = [0, 0], buffer.has_chunks()
            with contextlib.suppress(Exception):
                note["padding"] = list(buffer.get_image_padding())[-2:]
            if self._parser is not None and buffer.has_chunks():
                with contextlib.suppress(Exception):
                    note["exposure_us"] = self._parser.get_float_value(buffer, "ChunkExposureTime")
        return note

    def counts(self) -> dict[str, int]:
        """Return the frame statistics, summed over all streams."""
        counts, stream = dict(self._totals), self._stream
        if stream is None:
            return counts
        for name in (stream.get_info_name(i) for i in range(stream.get_n_infos())):
            if name.startswith("n_"):
                key = name.removeprefix("n_")
                counts[key] = counts.get(key, 0) + stream.get_info_uint64_by_name(name)
        return counts
