"""A GigE Vision camera on the loopback, whose pictures this process renders, and its faults."""

from __future__ import annotations

import contextlib
import math
import mmap
import signal
import socket
import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Self, get_args

import numpy as np
from numpy.typing import NDArray

from drivers.aravis.library_process import python_with_gi
from drivers.aravis.pixel_formats import FORMATS, PixelFormat
from drivers.device_holders import udp_socket_holder
from drivers.hosted.calls import CallRequest, CallResult, Notification
from drivers.hosted.child_process import ChildProcess
from drivers.hosted.message_socket import LineClosed, MessageTimeout
from drivers.interfaces import Clock
from simulator.wire.camera_xml import FEATURES, apply_features, genicam_xml, register_of
from simulator.wire.gige_process import HEADER_BYTES, GigERegister
from simulator.world import World

CameraFaultKind = Literal[
    "lost packets",
    "missing frame",
    "late frame",
    "corrupt frame",
    "stale frame",
    "wrong exposure",
    "stopped stream",
    "heartbeat loss",
    "silence",
    "disconnect",
]
"""Kinds of faults, by name.

lost packets: half of a frame's packets don't arrive. missing frame: no packet of a frame arrives.
late frame: a frame comes 1.5 s too late. corrupt frame: a frame's leader reports another size.
stale frame: a new exposure takes effect three frames late. wrong exposure: the camera doubles its
exposure by itself, and reports it when asked. stopped stream: triggers have no effect. heartbeat
loss: the camera forgets which program controls it. silence: it neither receives nor sends.
disconnect: it is gone, and returns in the state after power-up."""

CAMERA_FAULT_KINDS: tuple[CameraFaultKind, ...] = get_args(CameraFaultKind)


@dataclass(frozen=True)
class CameraFault:
    """One fault of a GigE camera.

    kind: one of CAMERA_FAULT_KINDS. at: time at which it begins, in seconds of the bench's clock.
    seconds: its duration.
    """

    kind: CameraFaultKind
    at: float = 0.0
    seconds: float = math.inf

    def __post_init__(self) -> None:
        if self.kind not in CAMERA_FAULT_KINDS:
            raise ValueError(f"kind is {self.kind!r}; choose {', '.join(CAMERA_FAULT_KINDS)}")
        if not self.seconds > 0:
            raise ValueError(f"seconds is {self.seconds:g}; it must be positive")


def pack_pixels(image: NDArray[np.uint16], form: PixelFormat) -> NDArray[np.uint8]:
    """Pack a picture's pixels into bytes; numbers are limited to the format's full scale."""
    pixels = np.minimum(image.reshape(-1), form.full_scale).astype(np.uint16)
    match form.layout:
        case "bytes":
            return pixels.astype(np.uint8)
        case "words":
            return pixels.astype("<u2").view(np.uint8)
        case "packed":
            # Two pixels in three bytes: the high bits of each around the low bits of both.
            count, extra = pixels.size, form.bits - 8
            a, b = np.append(pixels, np.zeros(count % 2, np.uint16)).reshape(-1, 2).T
            low = (1 << extra) - 1
            groups = np.stack([a >> extra, (b & low) << 4 | a & low, b >> extra], 1)
            return groups.astype(np.uint8).reshape(-1)[: -(-count * 12 // 8)]
        case "p":
            two_bytes = pixels.astype("<u2").view(np.uint8).reshape(-1, 2)
            ones = np.unpackbits(two_bytes, axis=1, bitorder="little")[:, : form.bits]
            return np.packbits(ones.reshape(-1), bitorder="little")


RenderImage = Callable[[float, float], NDArray[np.uint16]]
"""Function that renders the sensor's picture (rows, columns) from an exposure in seconds and a gain
in decibels."""


PackPixels = Callable[[NDArray[np.uint16], PixelFormat], NDArray[np.uint8]]
"""Function that packs a picture into the bytes that are sent."""


def frame_renderer(world: World) -> RenderImage:
    """Return the `render` function that shows the virtual bench to a `FakeGigECamera`.

    Each picture has its own noise and shows the bench in its state at that time. Numbers that the
    gain raises above the sensor's full scale are clipped there.
    """
    # A running camera may request two frames at once, and the world has only one state.
    turn = threading.Lock()

    def render_frame(exposure: float, gain_db: float) -> NDArray[np.uint16]:
        with turn:
            stream, _ = world.stream(exposure)
            image = stream.frame(world.random_generator())
        if not gain_db:
            return image
        more = np.rint(image * 10 ** (gain_db / 20))
        return np.minimum(more, world.camera.sensor.full_scale).astype(np.uint16)

    return render_frame


class NoAravis(OSError):
    """Raised when Aravis, or Python's gi, isn't installed."""


class FakeGigECamera:
    """Run Aravis' fake camera in a process of its own, with real GVCP and GVSP packets.

    render: called in a thread of this process for each frame, whose noise must be its own: the
    driver refuses a frame that comes again. Without `always_render`, it is called `cycle_length`
    times whenever exposure, gain or region has changed, or `mark_scene_changed()` was called, and
    these pictures are sent in turn. shape: of the sensor. pixel_format: after power-up. latency:
    frames after which a new exposure takes effect. exposure_us: shortest and longest in
    microseconds. address: of this computer, for one camera at a time. features: values of FEATURES
    after power-up. pack: how pictures become bytes. leader: what each frame's leader says otherwise
    than the registers do: code, width, height, x, y, padding (bytes after each line), stamp
    (nanoseconds), clock_rate (seconds of its clock in one second). more_bytes: by which a payload
    may exceed the picture. Entering raises NoAravis if there is no gi, and OSError if the address
    isn't free.

    Pixels are averaged for binning, cropped to the region and limited to full scale. A triggered
    exposure takes its real time; a free-running camera exposes all the time.
    """

    def __init__(
        self,
        render: RenderImage,
        shape: tuple[int, int] = (512, 512),
        pixel_format: str = "Mono16",
        *,
        pixel_formats: Sequence[str] = tuple(FORMATS),
        always_render: bool = True,
        cycle_length: int = 1,
        latency: int = 0,
        exposure_us: tuple[int, int] = (10, 60_000_000),
        serial: str = "SIM01",
        address: str = "127.0.0.1",
        clock: Clock | None = None,
        faults: Sequence[CameraFault] = (),
        features: Mapping[str, float] | None = None,
        pack: PackPixels | None = None,
        leader: Mapping[str, float] | None = None,
        more_bytes: int = 0,
    ) -> None:
        if not 0 <= latency <= 8:
            raise ValueError(f"latency is {latency}; it must be from 0 to 8 frames")
        if cycle_length < 1:
            raise ValueError(f"cycle_length is {cycle_length}; one picture at least is needed")
        self._fill, self._cycle, self._pack = render, cycle_length, pack
        self._leader, self._more = dict(leader or {}), more_bytes
        self.shape, self.address, self.serial = shape, address, serial
        self._formats = {FORMATS[n].code: FORMATS[n] for n in (*pixel_formats, pixel_format)}
        size = shape[0] * shape[1] * 2 + more_bytes
        self._slot = -(-size // mmap.PAGESIZE) * mmap.PAGESIZE
        values = {name: one.start for name, one in FEATURES.items()} | dict(features or {})
        self._exposure_us = exposure_us
        self._start_settings = {
            "address": address, "serial": serial, "shape": shape, "latency": latency,
            "code": FORMATS[pixel_format].code, "fresh": always_render,
            "features": [register_of(name, value) for name, value in values.items()],
        }  # fmt: skip
        self._clock, self._faults = clock, list(faults)
        self.failure: Exception | None = None
        """Exception of the last call of `render` that failed; its frame isn't sent."""
        self.render_count = 0
        """Number of calls of `render`."""

    def __enter__(self) -> Self:
        _await_free(self.address)
        with contextlib.ExitStack() as stack:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="labapp-")))
            xml = folder / "camera.xml"
            names = [form.name for form in self._formats.values()]
            xml.write_text(genicam_xml(dict.fromkeys(names), self._exposure_us))
            try:
                self._process = ChildProcess(
                    "gige_process:main",
                    {**self._start_settings, "xml": str(xml)},
                    python=python_with_gi(),
                    folders=[str(Path(__file__).parent)],
                    # There are two sets of pictures: one is sent while the other is rendered.
                    memory=HEADER_BYTES + 2 * self._cycle * self._slot,
                )
            except FileNotFoundError as error:
                raise NoAravis(f"no Python with gi: {error}") from error
            self._memory = mmap.mmap(self._process.line.memory, 0)
            self._ended, self._sent, self._set = False, "", 0
            self._obeyed_event = threading.Event()
            self._counting, self._scripting = threading.Lock(), threading.RLock()
            stack.callback(self._close)
            self._require_running()
            self._thread = threading.Thread(target=self._serve, daemon=True)
            self._thread.start()
            if self._leader or self._more:
                self._send_request("set_leader", self._leader)
                more = [(int(GigERegister.MORE_BYTES), self._more)]
                self._send_request("write_registers", more)
            self._closing = stack.pop_all()
        return self

    def __exit__(self, *error: object) -> None:
        self._closing.close()

    def _require_running(self) -> None:
        try:
            # The process has 10 s to load its library.
            running, reply = self._process.receive(10.0).result(), "it doesn't run"
        except (ImportError, ValueError) as missing:
            raise NoAravis(str(missing)) from missing
        except Exception as error:
            running, reply = False, str(error)
        if not running:
            raise OSError(f"no simulated camera at {self.address}: {reply}")

    def _close(self) -> None:
        self._ended = True
        self._process.kill()
        if hasattr(self, "_thread"):
            self._thread.join(10.0)
        self._process.close()

    def mark_scene_changed(self) -> None:
        """Tell the camera to render new pictures of a changed scene."""
        with self._counting:
            count = int.from_bytes(self._memory[:8], "little") + 1
            self._memory[:8] = count.to_bytes(8, "little")

    def inject(self, fault: CameraFault) -> None:
        """Add a fault; one whose time has come is active on return."""
        with self._scripting:
            self._faults.append(fault)
            self._follow_script()

    def clear_faults(self) -> None:
        """Remove all faults, active and future ones."""
        with self._scripting:
            self._faults.clear()
            self._follow_script()

    def set_latency(self, frames: int) -> None:
        """Set how many frames late a new exposure takes effect."""
        self._send_request("set_latency", frames)

    def set_features(self, **values: float) -> None:
        """Change features, as if the camera did so by itself."""
        registers = [register_of(name, value) for name, value in values.items()]
        self._send_request("write_registers", registers)

    def pulse(self) -> None:
        """Send an electric pulse down the trigger line."""
        self._process.send(Notification("pulse"))

    def _now(self) -> float:
        return time.monotonic() if self._clock is None else self._clock.now()

    def _follow_script(self) -> None:
        with self._scripting:
            now = self._now()
            self._faults = [f for f in self._faults if now < f.at + f.seconds]
            kinds = [f.kind for f in self._faults if f.at <= now]
            kind = kinds[-1] if kinds else ""
            if kind == self._sent:
                return
            if self._sent == "silence":
                self._process.send_signal(signal.SIGCONT)
            before, self._sent = self._sent, kind
            if kind == "silence":
                self._process.send_signal(signal.SIGSTOP)
            elif (before, kind) != ("silence", ""):
                self._send_request("set_fault", kind)

    def _send_request(self, name: str, *given: Any) -> None:
        """Send a request to the camera's process, and await a reply.

        The thread that receives the replies doesn't wait, because it would wait for itself.
        """
        self._obeyed_event.clear()
        self._process.send(CallRequest(name, given))
        if threading.current_thread() is not self._thread:
            self._obeyed_event.wait(5.0)

    def _serve(self) -> None:
        with contextlib.suppress(LineClosed):
            while not self._ended:
                with contextlib.suppress(MessageTimeout):
                    # Every 10 ms the faults whose time has come begin or end.
                    message: Notification | CallResult = self._process.line.receive(0.01)
                    if isinstance(message, Notification):
                        render, wanted = self._render_pictures, message.arguments
                        threading.Thread(target=render, args=wanted, daemon=True).start()
                    else:
                        self._obeyed_event.set()
                if self._scripting.acquire(blocking=False):
                    try:
                        self._follow_script()
                    finally:
                        self._scripting.release()

    def _render_pictures(self, request: dict[str, Any]) -> None:
        """Render requested pictures into the set of memory places that isn't being sent."""
        self._set ^= 1
        places = [(self._set * self._cycle + number) * self._slot for number in range(self._cycle)]
        form, pack = self._formats[request["code"]], self._pack or pack_pixels
        try:
            for place in places:
                self.render_count += 1
                image = self._fill(request["us"] * 1e-6, request["gain"] * 0.1)
                image = apply_features(image, request["features"], form.full_scale)
                data = pack(_crop_and_bin(image, request["region"]), form)
                start = HEADER_BYTES + place
                self._memory[start : start + data.size] = data.tobytes()
        except Exception as error:
            self.failure = error
            return
        self._process.send(Notification("receive_pictures", (places, request, data.size)))


def _crop_and_bin(image: NDArray[np.uint16], region: Sequence[int]) -> NDArray[np.uint16]:
    """Bin and crop a picture.

    region: x, y, width, height, binning across and down.
    """
    x, y, width, height, across, down = region
    if across * down > 1:
        rows, columns = image.shape[0] // down, image.shape[1] // across
        blocks = image[: rows * down, : columns * across].reshape(rows, down, columns, across)
        image = np.rint(blocks.mean(axis=(1, 3))).astype(np.uint16)
    part = np.zeros((height, width), np.uint16)
    there = image[y : y + height, x : x + width]
    part[: there.shape[0], : there.shape[1]] = there
    return part


def _await_free(address: str) -> None:
    """Wait until the GigE port is free of other cameras; OSError after 20 s."""
    # GigE Vision has a fixed port.
    port = 3956
    late = time.monotonic() + 20.0
    while True:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind((address, port))
                return
            except OSError as error:
                if time.monotonic() > late:
                    who = udp_socket_holder(port) or "another program"
                    raise OSError(f"{address}:{port} is in use by {who}") from error
        time.sleep(0.1)
