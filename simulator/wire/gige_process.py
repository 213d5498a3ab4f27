"""The life of the simulated camera's process: Aravis' fake camera, and pictures from outside.

With Python's standard library, gi and `drivers.hosted`, so that the system's Python can run
it. The fake camera speaks GigE Vision; here are its exposures, which take their time, and
what goes wrong with it. The registers from 0x3d0 on are ours; the others are the fake's.
"""

from __future__ import annotations

import contextlib
import ctypes
import mmap
import os
import socket
import struct
import threading
import time
from collections import deque
from typing import Any

from drivers.hosted.calls import CallRequest, CallResult, Notification
from drivers.hosted.message_socket import MessageSocket

EXPOSURE, GAIN, WIDTH, HEIGHT, X, Y = 0x120, 0x110, 0x100, 0x104, 0x130, 0x134
ACROSS, DOWN, FORMAT, RUNNING = 0x108, 0x10C, 0x128, 0x124
SENSOR_HEIGHT, SENSOR_WIDTH = 0x118, 0x11C
TRIGGER_MODE, FAKE_TRIGGER_SOURCE, FAKE_TRIGGER = 0x300, 0x304, 0x30C
TEMPERATURE, TRIGGER, TRIGGER_SOURCE = 0x3D0, 0x3F0, 0x3F4
PRIVILEGE, STREAM_PORT, STREAM_ADDRESS = 0x0A00, 0x0D00, 0x0D18

HEADER_BYTES = 4096
"""Bytes before the pictures: the first eight count changes of what the camera sees."""

_POLL_INTERVAL = 0.001
"""Seconds between looks at whether a trigger has come."""

_LATE_DELAY = 1.5
"""Seconds by which a late frame is late."""

_STALE_FRAMES = 3
"""Frames after which a stale camera obeys."""

_PICTURE_TIMEOUT = 0.3
"""Seconds for which a free-running camera waits for a picture before it loses the frame."""

_FILL = ctypes.CFUNCTYPE(
    None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_uint32, ctypes.c_uint32, ctypes.c_uint32
)


class GigEMachine:
    """The camera. ask: is called with what is wanted, and answers with pictures' places."""

    def __init__(self, aravis: Any, given: dict[str, Any], memory: int) -> None:
        self._aravis, self._start_settings = aravis, given
        self._memory = mmap.mmap(memory, 0)
        self._base = ctypes.addressof(ctypes.c_char.from_buffer(self._memory))
        self._library = ctypes.CDLL("libaravis-0.8.so.0")
        self._library.arv_buffer_get_data.restype = ctypes.c_void_p
        self._library.arv_buffer_get_frame_id.restype = ctypes.c_uint64
        self._library.arv_buffer_get_frame_id.argtypes = [ctypes.c_void_p]
        self._library.arv_buffer_get_data.argtypes = [ctypes.c_void_p, ctypes.c_void_p]
        self._library.arv_fake_camera_set_fill_pattern.argtypes = [
            ctypes.c_void_p,
            _FILL,
            ctypes.c_void_p,
            ctypes.c_void_p,
        ]
        self._callback = _FILL(self._fill_buffer)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._exposure_history: deque[int] = deque(maxlen=8)
        self._key: Any = None
        self._places: list[int] = []
        self._turn = 0
        self._next: int | None = None
        self._pending_key: Any = None
        self._request: dict[str, Any] = {}
        self._arrived = threading.Condition()
        self._pulses = 0
        self.latency = int(given["latency"])
        self.fault = ""
        self.ask: Any = None
        self._plug_in()
        threading.Thread(target=self._serve_triggers, daemon=True).start()

    @property
    def running(self) -> bool:
        return bool(self._server is not None and self._server.is_running())

    def _plug_in(self) -> None:
        given = self._start_settings
        server = self._aravis.GvFakeCamera.new_full(given["address"], given["serial"], given["xml"])
        fake = server.get_fake_camera()
        fake.set_trigger_frequency(1000.0)
        rows, columns = given["shape"]
        for register, value in (
            (SENSOR_WIDTH, columns),
            (SENSOR_HEIGHT, rows),
            (WIDTH, columns),
            (HEIGHT, rows),
            (FORMAT, given["code"]),
            (FAKE_TRIGGER_SOURCE, 1),
            (TEMPERATURE, 4150),
        ):
            fake.write_register(register, value)
        self._library.arv_fake_camera_set_fill_pattern(hash(fake), self._callback, None, None)
        self._exposure_history.clear()
        self._fake, self._server = fake, server

    def set_fault(self, kind: str) -> None:
        """A fault begins, or all end if empty."""
        before, self.fault = self.fault, kind
        if kind == "disconnect" and self._server is not None:
            self._server = self._fake = None
        elif before == "disconnect" and kind != before:
            self._plug_in()
        fake = self._fake
        if fake is not None and kind == "heartbeat loss":
            fake.write_register(PRIVILEGE, 0)

    def set_latency(self, frames: int) -> None:
        self.latency = frames

    def pulse(self) -> None:
        """An electric pulse at the trigger line."""
        self._pulses += 1

    def _register(self, address: int) -> int:
        fake = self._fake
        if fake is None:
            return 0
        answer = fake.read_register(address)
        return int(answer[-1] if isinstance(answer, tuple) else answer)

    def _write(self, address: int, value: int) -> None:
        fake = self._fake
        if fake is not None:
            fake.write_register(address, value)

    def _serve_triggers(self) -> None:
        """Triggers become frames after their exposure's time, one after the other."""
        while True:
            time.sleep(_POLL_INTERVAL)
            if not self._register(RUNNING) or not self._register(TRIGGER_MODE):
                self._pulses = 0
                self._write(TRIGGER, 0)
                self._write(FAKE_TRIGGER, 0)
                continue
            if self._register(TRIGGER_SOURCE) == 1:
                come = self._register(TRIGGER) == 1
            else:
                come, self._pulses = self._pulses > 0, 0
            if not come:
                continue
            self._write(TRIGGER, 0)
            if self.fault == "stopped stream":
                continue
            began, stream = time.monotonic(), self._register(STREAM_PORT)
            us = self._start_exposure()
            places = self._request_pictures(us, 60.0)
            if places is None:
                continue
            self._next = self._next_picture(places)
            ready = began + us * 1e-6 + (_LATE_DELAY if self.fault == "late frame" else 0)
            while time.monotonic() < ready and self._is_still_streaming(stream):
                time.sleep(min(0.005, max(0.0, ready - time.monotonic())))
            if self._is_still_streaming(stream):
                self._write(FAKE_TRIGGER, 1)

    def _is_still_streaming(self, stream: int) -> bool:
        """Whether the acquisition hasn't been stopped, nor started anew for another stream."""
        return bool(self._register(RUNNING)) and self._register(STREAM_PORT) == stream

    def _start_exposure(self) -> int:
        """Microseconds that the frame that begins now is exposed."""
        if self.fault == "wrong exposure":
            self._write(EXPOSURE, 2 * self._register(EXPOSURE))
        self._exposure_history.append(self._register(EXPOSURE))
        return self._effective_exposure_us()

    def _effective_exposure_us(self) -> int:
        """Of what it was told at the last frames' beginnings, what it obeys by now."""
        late = _STALE_FRAMES if self.fault == "stale frame" else self.latency
        return self._exposure_history[max(0, len(self._exposure_history) - 1 - late)]

    def _request_pictures(self, us: int, patience: float) -> list[int] | None:
        """Where pictures of that exposure lie; None if nobody has made them in time."""
        region = [self._register(r) for r in (X, Y, WIDTH, HEIGHT, ACROSS, DOWN)]
        seen = struct.unpack_from("=Q", self._memory, 0)[0]
        key = (us, self._register(GAIN), tuple(region), self._register(FORMAT), seen)
        if key == self._key and not self._start_settings["fresh"]:
            return self._places
        with self._arrived:
            if self._pending_key != key or self._start_settings["fresh"]:
                self._pending_key = key
                self._places = []
                self._request = {"us": us, "gain": key[1], "region": region, "code": key[3]}
                self._request["seen"] = seen
                self.ask(self._request)
            if not self._arrived.wait_for(lambda: bool(self._places), patience):
                return None
            self._key, self._pending_key = key, None
            return self._places

    def receive_pictures(self, places: list[int], request: dict[str, Any]) -> None:
        """Pictures have come. Those of what isn't asked for any more, being late, are not taken."""
        with self._arrived:
            if request != self._request:
                return
            self._places = places
            self._arrived.notify_all()

    def _next_picture(self, places: list[int]) -> int:
        self._turn += 1
        return places[self._turn % len(places)]

    def _fill_buffer(self, buffer: Any, data: Any, us: int, gain: int, code: int) -> None:
        """Called by the fake camera for each frame that it sends."""
        fake, server = self._fake, self._server
        if fake is None or server is None:
            return
        place = self._next
        if not self._register(TRIGGER_MODE):
            # What was set when this frame's exposure began, at the tick before.
            begun = self._effective_exposure_us() if self._exposure_history else us
            self._start_exposure()
            places = self._request_pictures(begun, _PICTURE_TIMEOUT)
            place = None if places is None else self._next_picture(places)
        lost = {"lost packets": 0.5, "missing frame": 1.0, "stopped stream": 1.0}
        server.set_property("gvsp-lost-ratio", lost.get(self.fault, 0.0))
        if place is None:
            server.set_property("gvsp-lost-ratio", 1.0)
            return
        target = self._library.arv_buffer_get_data(buffer, None)
        ctypes.memmove(target, self._base + HEADER_BYTES + place, fake.get_payload())
        if self.fault == "corrupt frame":
            self._send_forged_leader(self._library.arv_buffer_get_frame_id(buffer))

    def _send_forged_leader(self, number: int) -> None:
        """A leader with another size goes before the right one."""
        height = max(1, self._register(HEIGHT) // 2)
        leader = struct.pack(">HHI", 0, number & 0xFFFF, 0x01000000)
        leader += struct.pack(">HHQ", 0, 1, time.time_ns())
        leader += struct.pack(
            ">IIIIIHH", self._register(FORMAT), self._register(WIDTH), height, 0, 0, 0, 0
        )
        address = socket.inet_ntoa(struct.pack(">I", self._register(STREAM_ADDRESS)))
        with contextlib.suppress(OSError):
            self._socket.sendto(leader, (address, self._register(STREAM_PORT) & 0xFFFF))


def main(line: MessageSocket, given: dict[str, Any]) -> None:
    """Answer whether the camera is there, and then obey; what is said is named as its method."""
    import gi

    gi.require_version("Aravis", "0.8")
    from gi.repository import Aravis

    machine = GigEMachine(Aravis, given, line.memory)

    def ask(wanted: dict[str, Any]) -> None:
        with contextlib.suppress(OSError):
            line.send(Notification("make", (wanted,)))

    machine.ask = ask
    line.send(CallResult(machine.running))
    with contextlib.suppress(EOFError, OSError):
        while True:
            message: CallRequest | Notification = line.receive()
            done = getattr(machine, message.name)(*message.arguments)
            if isinstance(message, CallRequest):
                line.send(CallResult(done))
    os._exit(0)
