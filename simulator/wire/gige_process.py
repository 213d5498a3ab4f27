"""Program of the simulated camera's process: Aravis' fake camera with pictures from outside.

It adds the duration of exposures and the faults. The system's Python runs it: it uses only the
standard library, gi and `drivers.hosted`.
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
from enum import IntEnum
from typing import Any

from drivers.hosted.calls import CallRequest, CallResult, Notification
from drivers.hosted.message_socket import MessageSocket

HEADER_BYTES = 4096
"""Bytes of shared memory before the pictures; the first eight count the changes of the scene."""

# Seconds between looks for a trigger, and for a stream that waits for triggers. Chosen: of no
# account beside what a frame takes on its way.
_TRIGGER_INTERVAL, _IDLE_INTERVAL = 2e-3, 10e-3

_FILL = ctypes.CFUNCTYPE(
    None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_uint32, ctypes.c_uint32, ctypes.c_uint32
)


class GigERegister(IntEnum):
    """Addresses of the camera's registers.

    TEMPERATURE, MORE_BYTES, TRIGGER and TRIGGER_SOURCE belong to this module, those from PRIVILEGE
    on to GigE Vision, and the others to Aravis' fake camera.
    """

    WIDTH = 0x100
    HEIGHT = 0x104
    ACROSS = 0x108
    DOWN = 0x10C
    GAIN = 0x110
    SENSOR_HEIGHT = 0x118
    SENSOR_WIDTH = 0x11C
    EXPOSURE = 0x120
    RUNNING = 0x124
    FORMAT = 0x128
    X = 0x130
    Y = 0x134
    TRIGGER_MODE = 0x300
    FAKE_TRIGGER_SOURCE = 0x304
    FAKE_TRIGGER = 0x30C
    TEMPERATURE = 0x3D0
    MORE_BYTES = 0x3DC
    TRIGGER = 0x3F0
    TRIGGER_SOURCE = 0x3F4
    PRIVILEGE = 0x0A00
    STREAM_PORT = 0x0D00
    PACKET_SIZE = 0x0D04
    STREAM_ADDRESS = 0x0D18


class GigEMachine:
    """Simulate a GigE camera: drive Aravis' fake camera and give it its pictures.

    ask: called with a request for pictures; `receive_pictures` takes the places of the result.
    """

    def __init__(self, aravis: Any, given: dict[str, Any], memory: int) -> None:
        self._aravis, self._start_settings = aravis, given
        self._memory = mmap.mmap(memory, 0)
        self._base = ctypes.addressof(ctypes.c_char.from_buffer(self._memory))
        pointer, library = ctypes.c_void_p, ctypes.CDLL("libaravis-0.8.so.0")
        library.arv_buffer_get_data.restype = pointer
        library.arv_buffer_get_data.argtypes = [pointer, pointer]
        library.arv_buffer_get_frame_id.restype = ctypes.c_uint64
        library.arv_buffer_get_frame_id.argtypes = [pointer]
        library.arv_fake_camera_set_fill_pattern.argtypes = [pointer, _FILL, pointer, pointer]
        self._library, self._callback = library, _FILL(self._fill_buffer)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._exposure_history: deque[int] = deque(maxlen=9)
        self._key: Any = None
        self._pending_key: Any = None
        self._request: dict[str, Any] = {}
        self._places: list[int] = []
        self._next: int | None = None
        self._turn = self._pulses = self._size = 0
        self._arrived = threading.Condition()
        self.leader: dict[str, Any] = {}
        self.latency, self.fault = int(given["latency"]), ""
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
        r = GigERegister
        start = {r.SENSOR_WIDTH: columns, r.SENSOR_HEIGHT: rows, r.WIDTH: columns, r.HEIGHT: rows}
        start |= {r.FORMAT: given["code"], r.FAKE_TRIGGER_SOURCE: 1, r.TEMPERATURE: 4150}
        for register, value in (*start.items(), *given["features"]):
            fake.write_register(register, value)
        self._library.arv_fake_camera_set_fill_pattern(hash(fake), self._callback, None, None)
        self._exposure_history.clear()
        self._fake, self._server = fake, server

    def set_fault(self, kind: str) -> None:
        """Begin a fault, or end all if `kind` is empty."""
        before, self.fault = self.fault, kind
        if kind == "disconnect" and self._server is not None:
            self._server = self._fake = None
        elif before == "disconnect" and kind != before:
            self._plug_in()
        if kind == "heartbeat loss":
            self._write(GigERegister.PRIVILEGE, 0)

    def set_leader(self, leader: dict[str, Any]) -> None:
        """Set what the frames' leaders tell; see FakeGigECamera."""
        self.leader = leader

    def write_registers(self, values: list[tuple[int, int]]) -> None:
        """Write registers, as if the camera did so by itself."""
        for address, value in values:
            self._write(address, value)

    def set_latency(self, frames: int) -> None:
        self.latency = frames

    def pulse(self) -> None:
        """Take an electric pulse from the trigger line."""
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
        """Turn each trigger into a frame after the exposure time, one after the other."""
        while True:
            running = self._register(GigERegister.RUNNING)
            if not running or not self._register(GigERegister.TRIGGER_MODE):
                self._pulses = 0
                self._write(GigERegister.TRIGGER, 0)
                self._write(GigERegister.FAKE_TRIGGER, 0)
                time.sleep(_IDLE_INTERVAL)
                continue
            time.sleep(_TRIGGER_INTERVAL)
            if self._register(GigERegister.TRIGGER_SOURCE) == 1:
                come = self._register(GigERegister.TRIGGER) == 1
            else:
                come, self._pulses = self._pulses > 0, 0
            if not come:
                continue
            self._write(GigERegister.TRIGGER, 0)
            if self.fault == "stopped stream":
                continue
            began, stream = time.monotonic(), self._register(GigERegister.STREAM_PORT)
            us = self._start_exposure()
            places = self._request_pictures(us, 60.0)
            if places is None:
                continue
            self._next = self._next_picture(places)
            ready = began + us * 1e-6 + (1.5 if self.fault == "late frame" else 0)
            while time.monotonic() < ready and self._is_still_streaming(stream):
                time.sleep(min(0.005, max(0.0, ready - time.monotonic())))
            if self._is_still_streaming(stream):
                self._write(GigERegister.FAKE_TRIGGER, 1)

    def _is_still_streaming(self, stream: int) -> bool:
        """Return whether the same stream still runs."""
        running = bool(self._register(GigERegister.RUNNING))
        return running and self._register(GigERegister.STREAM_PORT) == stream

    def _start_exposure(self) -> int:
        """Begin an exposure; return its length in microseconds."""
        exposure = GigERegister.EXPOSURE
        if self.fault == "wrong exposure":
            self._write(exposure, 2 * self._register(exposure))
        self._exposure_history.append(self._register(exposure))
        return self._effective_exposure_us()

    def _effective_exposure_us(self) -> int:
        """Return the exposure that is obeyed now, in microseconds, after the latency in frames."""
        late = 3 if self.fault == "stale frame" else self.latency
        return self._exposure_history[max(0, len(self._exposure_history) - 1 - late)]

    def _request_pictures(self, us: int, patience: float) -> list[int] | None:
        """Request pictures of an exposure; return their memory places, or None after a timeout."""
        r = GigERegister
        region = [self._register(a) for a in (r.X, r.Y, r.WIDTH, r.HEIGHT, r.ACROSS, r.DOWN)]
        seen = struct.unpack_from("=Q", self._memory, 0)[0]
        start = self._start_settings.get("features", [])
        features = [self._register(address) for address, _ in start]
        gain, code = self._register(r.GAIN), self._register(r.FORMAT)
        key = (us, gain, tuple(region), code, seen, tuple(features))
        if key == self._key and not self._start_settings["fresh"]:
            return self._places
        with self._arrived:
            if self._pending_key != key or self._start_settings["fresh"]:
                self._pending_key = key
                self._places = []
                self._request = {"us": us, "gain": gain, "region": region, "code": code}
                self._request |= {"seen": seen, "features": features}
                self.ask(self._request)
            if not self._arrived.wait_for(lambda: bool(self._places), patience):
                return None
            self._key, self._pending_key = key, None
            return self._places

    def receive_pictures(self, places: list[int], request: dict[str, Any], size: int = 0) -> None:
        """Take rendered pictures to be sent; those for an outdated request are dropped.

        size: bytes of each; 0 for the usual ones.
        """
        with self._arrived:
            if request != self._request:
                return
            self._places, self._size = places, size
            self._arrived.notify_all()

    def _next_picture(self, places: list[int]) -> int:
        self._turn += 1
        return places[self._turn % len(places)]

    def _fill_buffer(self, buffer: Any, data: Any, us: int, gain: int, code: int) -> None:
        """Copy a picture into the frame that Aravis is about to send."""
        fake, server = self._fake, self._server
        if fake is None or server is None:
            return
        place = self._next
        if not self._register(GigERegister.TRIGGER_MODE):
            # This frame's exposure began with the frame before, so the exposure of then counts.
            begun = self._effective_exposure_us() if self._exposure_history else us
            self._start_exposure()
            # A free-running camera loses the frame if there is no picture after 0.3 s.
            places = self._request_pictures(begun, 0.3)
            place = None if places is None else self._next_picture(places)
        lost = {"lost packets": 0.5, "missing frame": 1.0, "stopped stream": 1.0}
        server.set_property("gvsp-lost-ratio", lost.get(self.fault, 0.0))
        if place is None:
            server.set_property("gvsp-lost-ratio", 1.0)
            return
        if self.leader or self._size not in (0, fake.get_payload()):
            server.set_property("gvsp-lost-ratio", 1.0)
            start, size = HEADER_BYTES + place, self._size or fake.get_payload()
            number = self._library.arv_buffer_get_frame_id(buffer)
            self._send_frame(number, self._memory[start : start + size])
            return
        target = self._library.arv_buffer_get_data(buffer, None)
        ctypes.memmove(target, self._base + HEADER_BYTES + place, fake.get_payload())
        if self.fault == "corrupt frame":
            # A leader of a wrong size comes before the right one.
            height = max(1, self._register(GigERegister.HEIGHT) // 2)
            number = self._library.arv_buffer_get_frame_id(buffer)
            self._send_packets([self._leader_packet(number, {"height": height})])

    def _send_frame(self, number: int, data: bytes) -> None:
        """Send a frame whose leader or size Aravis' fake camera can't have."""
        # Headers of IP, UDP and GVSP.
        length = (self._register(GigERegister.PACKET_SIZE) & 0xFFFF) - 20 - 8 - 8
        blocks = [data[start : start + length] for start in range(0, len(data), length)]
        trailer = struct.pack(">HHI", 0, 1, self._register(GigERegister.HEIGHT))
        packets = [self._leader_packet(number, self.leader)]
        packets += [
            struct.pack(">HHI", 0, number & 0xFFFF, 3 << 24 | place) + block
            for place, block in enumerate(blocks, 1)
        ]
        last = 2 << 24 | len(blocks) + 1
        packets.append(struct.pack(">HHI", 0, number & 0xFFFF, last) + trailer)
        self._send_packets(packets)

    def _leader_packet(self, number: int, told: dict[str, Any]) -> bytes:
        """Return the packet with which a frame begins.

        told: what it says otherwise than the registers do.
        """
        r = GigERegister
        names = {"code": r.FORMAT, "width": r.WIDTH, "height": r.HEIGHT, "x": r.X, "y": r.Y}
        fields = [told.get(name, self._register(address)) for name, address in names.items()]
        stamp = told.get("stamp", int(time.time_ns() * told.get("clock_rate", 1)))
        leader = struct.pack(">HHI", 0, number & 0xFFFF, 1 << 24) + struct.pack(">HHQ", 0, 1, stamp)
        return leader + struct.pack(">IIIIIHH", *fields, told.get("padding", 0), 0)

    def _send_packets(self, packets: list[bytes]) -> None:
        register = self._register
        address = socket.inet_ntoa(struct.pack(">I", register(GigERegister.STREAM_ADDRESS)))
        with contextlib.suppress(OSError):
            for packet in packets:
                self._socket.sendto(packet, (address, register(GigERegister.STREAM_PORT) & 0xFFFF))


def main(line: MessageSocket, given: dict[str, Any]) -> None:
    """Run the camera: report whether it runs, and then serve requests.

    A request has the name of the method of `GigEMachine` that it calls.
    """
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
