"""Devices of a bench behind their wires, whose plug somebody pulls and puts in again."""

from __future__ import annotations

import os
import subprocess
import threading
import time
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import numpy as np
from judges.wire_frames import telling, tells
from numpy.typing import NDArray
from small_bench.setups import small_setup

from drivers.clock import RealClock
from drivers.interfaces import Frame
from drivers.x11 import ScreenReader, XError
from labapp.bench.opening import BenchSetup
from labapp.files.bench_file import DeviceTable
from labapp.runs.shots import Shot
from simulator.machines.machine import SerialMachine
from simulator.machines.thorlabs_wheel import ThorlabsWheelMachine
from simulator.machines.usb_wheels import ZwoWheelMachine
from simulator.machines.varispec import VariSpecMachine
from simulator.screens import xvfb
from simulator.wire import SimulatedLine, WireFault
from simulator.wire.fake_gige import CameraFault, FakeGigECamera
from simulator.wire.pty import PtyLine
from simulator.wire.usb_backend import UsbBus
from simulator.wire.usb_remote import UsbServer, backend_option

_SLOTS = [[450, 10], [500, 10], [550, 10], [600, 10], [650, 10], [700, 10]]
_ADDRESS = "127.0.0.1"
_LOOK = 0.02
"""Seconds between looks at a screen."""

Seen = list[tuple[float, int]]
"""Times by time.monotonic() from which a screen's pixels had a checksum; -1 without a screen."""


def checksum_of(grey: NDArray[np.uint8]) -> int:
    return zlib.crc32(np.ascontiguousarray(grey).data)


@dataclass(frozen=True)
class Plug:
    """A bench with one device that isn't simulated in this process, and its plug.

    role: of the device on the bench. pull: its plug, for so many seconds. is_right: whether a
    frame is of what was planned, as the machine behind the wire knows. seen: what stood on the
    panel's screen, if the device is a screen.
    """

    role: str
    setup: BenchSetup
    pull: Callable[[float], None]
    is_right: Callable[[Shot, Frame], bool] = lambda shot, frame: True
    seen: Seen = field(default_factory=list)


@contextmanager
def varispec(folder: Path) -> Iterator[Plug]:
    """A tunable filter behind a serial line."""
    tuned: list[float] = []
    with _on_a_line(VariSpecMachine(on_tuned=tuned.append), 9600, folder) as (port, pull):
        yield _filter("varispec", {"port": port}, pull, lambda: tuned[-1])


@contextmanager
def thorlabs(folder: Path) -> Iterator[Plug]:
    """A filter wheel behind a serial line."""
    turned = [1]
    machine = ThorlabsWheelMachine(6, step=(0.4, 0.3), on_slot=turned.append)
    with _on_a_line(machine, 115200, folder) as (port, pull):
        options = {"port": port, "slots_nm": _SLOTS}
        yield _filter("thorlabs-wheel", options, pull, lambda: _SLOTS[turned[-1] - 1][0] * 1e-9)


@contextmanager
def zwo(folder: Path) -> Iterator[Plug]:
    """A filter wheel on a USB."""
    turned, clock = [1], RealClock()
    bus = UsbBus(clock)
    plug = bus.plug_in(ZwoWheelMachine(6, step=0.3, on_slot=turned.append))
    with UsbServer(bus, folder / "usb"):
        yield _filter(
            "zwo-wheel",
            {"backend": backend_option(folder / "usb"), "slots_nm": _SLOTS},
            lambda seconds: plug.inject(WireFault("disconnect", clock.now(), seconds)),
            lambda: _SLOTS[turned[-1] - 1][0] * 1e-9,
        )


@contextmanager
def gige(folder: Path) -> Iterator[Plug]:
    """A GigE Vision camera; its pictures tell by themselves how long they were exposed."""
    setup = small_setup()
    shape = (setup.bench.sensor.height, setup.bench.sensor.width)

    def picture(exposure: float, gain_db: float) -> NDArray[np.uint16]:
        return telling(np.random.default_rng(), shape, exposure)

    def is_right(shot: Shot, frame: Frame) -> bool:
        return tells(frame.image, shot.exposure)

    clock = RealClock()
    with FakeGigECamera(picture, shape, "Mono12", address=_ADDRESS, clock=clock) as camera:
        options = {"address": _ADDRESS, "pixel_format": "Mono12", "latency_frames": 0}

        def pull(seconds: float) -> None:
            camera.inject(CameraFault("disconnect", clock.now(), seconds))

        yield Plug("camera", _with(setup, "camera", "aravis-camera", options), pull, is_right)


@contextmanager
def screen(folder: Path) -> Iterator[Plug]:
    """A panel on a screen that is switched off and on, as when its cable is pulled."""
    setup, seen = small_setup(), Seen()
    panel = setup.bench.panel
    with xvfb(panel.width, panel.height) as server, _watched(server.display, seen):

        def switch(words: str) -> None:
            # Xvfb refuses a screen of no size, and switches its only output off before that.
            with suppress(subprocess.CalledProcessError):
                server.xrandr(f"--output screen {words}")

        def pull(seconds: float) -> None:
            switch("--off")
            _later(seconds, lambda: switch(f"--mode {panel.width}x{panel.height}"))

        yield Plug("slm", _on_screen(setup, server.display), pull, seen=seen)


@contextmanager
def x_server(folder: Path) -> Iterator[Plug]:
    """A panel on a screen whose X server ends, and is started again."""
    setup, seen = small_setup(), Seen()
    panel = setup.bench.panel
    # A number that nobody else takes meanwhile: free ones are looked for from 0 on.
    display = f":{100 + os.getpid() % 30000}"
    pulls: SimpleQueue[float | None] = SimpleQueue()
    ready = threading.Event()

    def serve() -> None:
        """In one thread, for a server ends with the thread that has started it."""
        seconds: float | None = 0.0
        while seconds is not None:
            time.sleep(seconds)
            with xvfb(panel.width, panel.height, display):
                ready.set()
                seconds = pulls.get()

    thread = threading.Thread(target=serve, name="X server")
    thread.start()
    try:
        ready.wait(30.0)
        with _watched(display, seen):
            yield Plug("slm", _on_screen(setup, display), pulls.put, seen=seen)
    finally:
        pulls.put(None)
        thread.join()


def _with(setup: BenchSetup, role: str, driver: str, options: dict[str, Any]) -> BenchSetup:
    table = DeviceTable(driver=driver, options=options, simulated=True)
    devices = setup.bench.devices.model_copy(update={role: table})
    return replace(setup, bench=setup.bench.model_copy(update={"devices": devices}))


def _filter(
    driver: str,
    options: dict[str, Any],
    pull: Callable[[float], None],
    stands: Callable[[], float],
) -> Plug:
    """stands: the wavelength in metres that the machine really passes."""

    def is_right(shot: Shot, frame: Frame) -> bool:
        return abs(stands() - shot.wavelength) < 0.02e-9

    # A picture that waits for a busy computer isn't what is unplugged here.
    setup = small_setup(reply_s=30.0)
    return Plug("filter", _with(setup, "filter", driver, options), pull, is_right)


@contextmanager
def _on_a_line(
    machine: SerialMachine, baudrate: int, folder: Path
) -> Iterator[tuple[str, Callable[[float], None]]]:
    """Its port, and what pulls its plug."""
    line = SimulatedLine(machine, baudrate=baudrate)
    with PtyLine(line, folder / "port") as served:

        def pull(seconds: float) -> None:
            line.inject(WireFault("disconnect", served.clock.now(), seconds))

        yield str(served.path), pull


def _on_screen(setup: BenchSetup, display: str) -> BenchSetup:
    panel = setup.bench.panel
    options = {
        "screen": "screen",
        "width": panel.width,
        "height": panel.height,
        "display": display,
        "settling_ms": 20.0,
        "allow_primary": True,
    }
    return _with(setup, "slm", "screen-slm", options)


def _later(seconds: float, work: Callable[[], None]) -> None:
    timer = threading.Timer(seconds, work)
    timer.daemon = True
    timer.start()


@contextmanager
def _watched(display: str, seen: Seen) -> Iterator[None]:
    """Somebody else looks at the screen, all the time."""
    over = threading.Event()

    def watch() -> None:
        while not over.wait(_LOOK):
            with suppress(XError), ScreenReader(display) as reader:
                while not over.wait(_LOOK):
                    seen.append((time.monotonic(), checksum_of(reader.grey())))
            seen.append((time.monotonic(), -1))

    thread = threading.Thread(target=watch, name="looks at the screen", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
