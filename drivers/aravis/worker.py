"""The life of Aravis' process: answers requests in JSON at a socket, frames lie in memory.

Stands alone: Python's standard library and gi, so that the system's Python can run it as a
file. Whoever started it decides what frames are good for; here is only what the library does.
"""

from __future__ import annotations

import contextlib
import ctypes
import ctypes.util
import json
import mmap
import os
import signal
import sys
import threading
import time
from multiprocessing.connection import Connection
from typing import Any

_LOOK = 0.2
"""Seconds between looks at whether the camera still obeys us."""

_LOST = 0.8
"""Seconds without a word from the camera after which it counts as lost."""

_ORPHANED = 10.0
"""Seconds in which this process must have ended after its parent has."""

_PRIVILEGE = 0x0A00
"""GigE Vision's register that says who controls the camera; 0 if nobody does."""

_HEARTBEAT = 0x0938
"""GigE Vision's register: milliseconds after which the camera forgets a silent controller."""

HEARTBEAT_MS = 1500
"""Milliseconds after which a camera may be opened again whose controller has died."""

_OBEYED = ("set_exposure", "set_gain", "trigger", "exposure", "start")
"""After these it is looked whether the camera still obeys us."""

OWNED = "somebody else has it open"
"""Why a camera can't be opened that answers, but doesn't obey."""

_TEMPERATURES = ("DeviceTemperature", "DeviceTemperatureRaw", "TemperatureAbs")
_TOLD = ("DeviceFirmwareVersion", "DeviceVersion", "DeviceUserID", "DeviceLinkSpeed")
_AUTOMATIC = ("ExposureAuto", "GainAuto", "BlackLevelAuto", "BalanceWhiteAuto", "GammaEnable")


class Lost(Exception):
    """The camera has gone, or obeys somebody else."""


class Camera:
    """An open camera; every public method answers a request of its name."""

    def __init__(self, aravis: Any, memory: int) -> None:
        self._aravis, self._memory = aravis, memory
        self._camera: Any = None
        self._stream: Any = None
        self._slots: dict[int, int] = {}
        self._held: dict[int, Any] = {}
        self._totals: dict[str, int] = {}
        self._parser: Any = None
        self._mapped: mmap.mmap | None = None
        self._size = ctypes.CDLL("libaravis-0.8.so.0").arv_buffer_get_data
        self._size.restype = ctypes.c_void_p
        self._size.argtypes = [ctypes.c_void_p, ctypes.POINTER(ctypes.c_size_t)]
        self.alive = time.monotonic()
        self.lost = ""

    def find(self) -> list[dict[str, str]]:
        a = self._aravis
        a.update_device_list()
        return [
            {
                "id": a.get_device_id(i) or "",
                "vendor": a.get_device_vendor(i) or "",
                "model": a.get_device_model(i) or "",
                "serial": a.get_device_serial_nbr(i) or "",
                "address": a.get_device_address(i) or "",
                "protocol": a.get_device_protocol(i) or "",
            }
            for i in range(a.get_n_devices())
        ]

    def open(self, address: str) -> None:
        """By its id, serial number, IP or USB address; the first one that is found if empty."""
        if address and address.count(".") != 3:
            for one in self.find():
                if address in (one["serial"], one["address"], one["id"]):
                    address = one["id"]
                    break
        camera = self._aravis.Camera.new(address or None)
        device = camera.get_device()
        if camera.is_gv_device():
            if not device.is_controller():
                raise RuntimeError(OWNED)
            device.write_register(_HEARTBEAT, HEARTBEAT_MS)
        self.alive = time.monotonic()
        self._camera, self._device = camera, device
        device.connect("control-lost", self._control_lost)
        threading.Thread(target=self._watch, daemon=True).start()

    def _control_lost(self, device: Any) -> None:
        self.lost = "control was lost: it went silent, or somebody else opened it"

    def _watch(self) -> None:
        while not self.lost:
            with contextlib.suppress(Exception):
                self.look()
            time.sleep(_LOOK)

    def look(self) -> None:
        """Whether the camera is there, and still obeys us."""
        if self._camera is None:
            return
        gige = self._camera.is_gv_device()
        answer = self._device.read_register(_PRIVILEGE if gige else 0)
        self.alive = time.monotonic()
        if gige and not answer & 3:
            self._control_lost(self._device)

    def gone(self) -> str:
        """Why it counts as lost; empty while it doesn't."""
        if not self.lost and self._camera and time.monotonic() - self.alive > _LOST:
            self.lost = f"no word from it for {_LOST:g} s"
        return self.lost

    def facts(self) -> dict[str, Any]:
        """What it is, what it can do, and how it is set."""
        c = self._camera
        facts: dict[str, Any] = {
            "vendor": c.get_vendor_name(),
            "model": c.get_model_name(),
            "serial": c.get_device_serial_number() or c.get_device_id(),
            "protocol": "GigE Vision" if c.is_gv_device() else "USB3 Vision",
            "sensor": _pair(c.get_sensor_size()),
            "exposure_us": list(_pair(c.get_exposure_time_bounds())),
            "pixel_formats": list(c.dup_available_pixel_formats_as_strings()),
            "gain_db": _pair(c.get_gain_bounds()) if c.is_gain_available() else None,
            "binning": None,
            "trigger_sources": [],
            "chunks": False,
            "rate": None,
        }
        with contextlib.suppress(Exception):
            if c.is_binning_available():
                facts["binning"] = [
                    *_pair(c.get_x_binning_bounds()),
                    *_pair(c.get_y_binning_bounds()),
                ]
        with contextlib.suppress(Exception):
            facts["trigger_sources"] = list(c.dup_available_trigger_sources())
        with contextlib.suppress(Exception):
            facts["chunks"] = bool(c.are_chunks_available())
        with contextlib.suppress(Exception):
            facts["rate"] = _pair(c.get_frame_rate_bounds())
        return facts

    def automatic_off(self) -> list[str]:
        """Turn off what the camera would change by itself; what couldn't be turned off."""
        stubborn = []
        for name in _AUTOMATIC:
            if not self._device.get_feature(name) or not self._device.is_feature_available(name):
                continue
            try:
                if name.endswith("Auto"):
                    self._device.set_string_feature_value(name, "Off")
                    off = self._device.get_string_feature_value(name) == "Off"
                else:
                    self._device.set_boolean_feature_value(name, False)
                    off = not self._device.get_boolean_feature_value(name)
            except Exception:
                off = False
            if not off:
                stubborn.append(name)
        return stubborn

    def set_exposure(self, us: float) -> float:
        self._camera.set_exposure_time(us)
        return float(self._camera.get_exposure_time())

    def exposure(self) -> float:
        return float(self._camera.get_exposure_time())

    def set_gain(self, gain: float) -> float:
        self._camera.set_gain(gain)
        return float(self._camera.get_gain())

    def set_pixel_format(self, name: str) -> str:
        if name:
            self._camera.set_pixel_format_from_string(name)
        return str(self._camera.get_pixel_format_as_string())

    def set_binning(self, across: int, down: int) -> list[int]:
        self._camera.set_binning(across, down)
        return _pair(self._camera.get_binning())

    def set_region(self, x: int, y: int, width: int, height: int) -> list[int]:
        """The whole sensor if width or height is 0."""
        c = self._camera
        with contextlib.suppress(Exception):
            c.set_region(0, 0, -1, -1)
        if not (width and height):
            x = y = 0
            width = _pair(c.get_width_bounds())[1]
            height = _pair(c.get_height_bounds())[1]
        c.set_region(x, y, width, height)
        return _four(c.get_region())

    def set_rate(self, rate: float) -> float:
        self._camera.set_frame_rate(rate)
        return float(self._camera.get_frame_rate())

    def set_trigger(self, source: str) -> str:
        """Wait for a trigger from there; go on by itself if empty."""
        if source:
            self._camera.set_trigger(source)
            return str(self._camera.get_trigger_source())
        self._camera.clear_triggers()
        return ""

    def set_packets(self, size: int) -> int:
        """Bytes of a packet; negotiated if 0. 0 where there are no packets."""
        if not self._camera.is_gv_device():
            return 0
        if size:
            self._camera.gv_set_packet_size(size)
        else:
            with contextlib.suppress(Exception):
                self._camera.gv_auto_packet_size()
        return int(self._camera.gv_get_packet_size())

    def set_chunks(self) -> bool:
        """Have each frame tell its own exposure; whether it will."""
        try:
            self._camera.set_chunks("ExposureTime")
            self._parser = self._camera.create_chunk_parser()
        except Exception:
            self._parser = None
        return self._parser is not None

    def start(self, buffers: int) -> dict[str, int]:
        """Begin with an empty queue at a port of its own: what is on its way never arrives."""
        self.stop()
        size = int(self._camera.get_payload())
        slot = -(-size // mmap.PAGESIZE) * mmap.PAGESIZE
        if self._mapped is None or len(self._mapped) != slot * buffers:
            os.ftruncate(self._memory, slot * buffers)
            self._mapped = mmap.mmap(self._memory, slot * buffers)
        base = ctypes.addressof(ctypes.c_char.from_buffer(self._mapped))
        self._stream = self._camera.create_stream(None, None)
        if self._stream is None:
            raise RuntimeError("no stream could be made")
        if self._camera.is_gv_device():
            self._stream.set_property("frame-retention", 100_000)
        for number in range(buffers):
            buffer = self._aravis.Buffer.new(size, base + number * slot)
            self._slots[hash(buffer)] = number * slot
            self._held[number * slot] = buffer
            self._stream.push_buffer(buffer)
        self._camera.set_acquisition_mode(self._aravis.AcquisitionMode.CONTINUOUS)
        self._camera.start_acquisition()
        return {"size": size, "slot": slot, "length": slot * buffers}

    def stop(self) -> None:
        if self._stream is None:
            return
        try:
            self._camera.stop_acquisition()
        finally:
            self._totals = self.counts()
            self._stream = None
            self._slots.clear()
            self._held.clear()

    def trigger(self) -> float:
        """The time.monotonic() before the camera was told."""
        began = time.monotonic()
        self._camera.software_trigger()
        return began

    def drain(self) -> list[int]:
        """Throw away what waits; the frames' numbers."""
        ids = []
        while (buffer := self._stream.try_pop_buffer()) is not None:
            ids.append(buffer.get_frame_id())
            self._stream.push_buffer(buffer)
        return ids

    def pop(self, seconds: float, back: int = -1) -> dict[str, Any] | None:
        """The next frame, None if there is none in time. back: the place of one that was read."""
        if back >= 0:
            self._stream.push_buffer(self._held[back])
        buffer = self._stream.timeout_pop_buffer(int(seconds * 1e6))
        if buffer is None:
            return None
        now, real = time.monotonic(), time.time_ns()
        status = self._aravis.BufferStatus(buffer.get_status()).value_nick
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
            note["region"] = _four(buffer.get_image_region())
            if self._parser is not None and buffer.has_chunks():
                with contextlib.suppress(Exception):
                    note["exposure_us"] = self._parser.get_float_value(buffer, "ChunkExposureTime")
        return note

    def counts(self) -> dict[str, int]:
        """What the library has counted of its streams."""
        counts, stream = dict(self._totals), self._stream
        if stream is None:
            return counts
        for name in (stream.get_info_name(i) for i in range(stream.get_n_infos())):
            if name.startswith("n_"):
                key = name.removeprefix("n_")
                counts[key] = counts.get(key, 0) + stream.get_info_uint64_by_name(name)
        return counts

    def health(self) -> dict[str, str]:
        told = {}
        for name in (*_TOLD, *_TEMPERATURES):
            with contextlib.suppress(Exception):
                if self._device.get_feature(name) and self._device.is_feature_available(name):
                    told[name] = self._told(name)
        return told

    def _told(self, name: str) -> str:
        node = self._device.get_feature(name)
        if isinstance(node, self._aravis.GcFloat):
            return f"{self._device.get_float_feature_value(name):g}"
        if isinstance(node, self._aravis.GcInteger):
            return str(self._device.get_integer_feature_value(name))
        return str(self._device.get_string_feature_value(name))

    def close(self) -> None:
        """Stop, and let others have the camera."""
        if self._camera is None:
            return
        with contextlib.suppress(Exception):
            self.stop()
        with contextlib.suppress(Exception):
            self._device.leave_control()


def _pair(two: Any) -> list[Any]:
    return [two[0], two[1]]


def _four(region: Any) -> list[int]:
    return [region[0], region[1], region[2], region[3]]


class _Desk:
    """Takes requests one by one; says at once if the camera is lost, while one lasts or not."""

    def __init__(self, end: Connection, camera: Camera) -> None:
        self._end, self._camera = end, camera
        self._owed = self._told = False
        self._lock = threading.Lock()
        threading.Thread(target=self._attend, daemon=True).start()

    def run(self) -> None:
        with contextlib.suppress(EOFError, OSError):
            while True:
                request = json.loads(self._end.recv_bytes())
                self._owed = True
                self._answer(self._done(**request))

    def _done(self, name: str, given: list[Any]) -> dict[str, Any]:
        if self._camera.gone():
            return {"lost": self._camera.lost}
        try:
            answer = getattr(self._camera, name)(*given)
            if name in _OBEYED:
                # A camera that obeys somebody else may have been set anew by them.
                self._camera.look()
            return {"lost": self._camera.lost} if self._camera.lost else {"good": answer}
        except Exception as error:
            if self._camera.gone():
                return {"lost": self._camera.lost}
            return {"bad": getattr(error, "message", "") or str(error) or repr(error)}

    def _answer(self, answer: dict[str, Any]) -> None:
        with self._lock:
            if self._owed:
                self._owed = False
                self._end.send_bytes(json.dumps(answer).encode())

    def _tell_lost(self) -> None:
        """Once, asked or not: whoever asks next takes it for the answer, which it is."""
        with self._lock:
            if not self._told:
                self._told, self._owed = True, False
                self._end.send_bytes(json.dumps({"lost": self._camera.lost}).encode())

    def _attend(self) -> None:
        parent = os.getppid()
        while True:
            time.sleep(0.05)
            if self._camera.gone():
                with contextlib.suppress(OSError):
                    self._tell_lost()
            if os.getppid() != parent:
                time.sleep(_ORPHANED)
                os._exit(1)


def main(end: str, memory: str) -> None:
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_SETMASK, ())
    connection = Connection(int(end))
    for descriptor in (int(end), int(memory)):
        os.set_inheritable(descriptor, False)
    try:
        import gi

        gi.require_version("Aravis", "0.8")
        from gi.repository import Aravis
    except (ImportError, ValueError) as error:
        connection.recv_bytes()
        connection.send_bytes(json.dumps({"missing": str(error)}).encode())
        return
    camera = Camera(Aravis, int(memory))
    try:
        _Desk(connection, camera).run()
    finally:
        camera.close()


if __name__ == "__main__":
    main(*sys.argv[1:])
