"""What is served: an instrument behind its wire, the driver for it, and what it may suffer."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

from drivers.interfaces import Clock
from labapp.bench.virtual_bench.shared import SharedWorld
from simulator.machines.machine import Machine
from simulator.wire.camera_faults import KINDS as CAMERA_KINDS
from simulator.wire.camera_faults import CameraFault, CameraFaultKind
from simulator.wire.fake_gige import FakeGigE
from simulator.wire.faults import WIRE_KINDS, WireFault
from simulator.wire.line import Line
from simulator.wire.pty import ServedLine
from simulator.wire.usb_plug import Plug

_PLUGGING = 1.0
"""Seconds in which a port comes or goes."""


@dataclass(frozen=True)
class Site:
    """Where instruments are served: a world, a folder for their ports, and what ends them."""

    shared: SharedWorld
    folder: Path
    stack: ExitStack

    @property
    def clock(self) -> Clock:
        return self.shared.clock


@dataclass(frozen=True)
class Instrument:
    """One that is served. driver, options: as in a bench file. kinds: of its faults."""

    driver: str
    options: dict[str, Any]
    kinds: tuple[str, ...] = ()
    fail: Callable[[str, float], None] = field(default=lambda kind, seconds: None)
    """Have something go wrong for so many seconds; ValueError for an unknown kind."""
    mend: Callable[[], None] = field(default=lambda: None)


def on_a_line(
    site: Site, driver: str, machine: Machine, baudrate: int, **options: Any
) -> Instrument:
    """An instrument at a serial port of the driver's name."""
    line, port = Line(machine, baudrate=baudrate), site.folder / driver
    site.stack.enter_context(ServedLine(line, port, site.clock))
    return on_a_wire(driver, {"port": str(port)} | options, line, machine.own_faults, site.clock)


def on_a_wire(
    driver: str, options: dict[str, Any], wire: Line | Plug, own: tuple[str, ...], clock: Clock
) -> Instrument:
    """An instrument behind a serial line or a USB plug. own: the machine's own faults."""
    port = Path(options["port"]) if "port" in options else None

    def fail(kind: str, seconds: float) -> None:
        wire.inject(WireFault(kind, clock.now(), seconds))
        _await(port, kind != "disconnect", clock)

    def mend() -> None:
        wire.mend()
        _await(port, True, clock)

    return Instrument(driver, options, (*WIRE_KINDS, *own), fail, mend)


def _await(port: Path | None, there: bool, clock: Clock) -> None:
    """Return when a port has come or gone, which whoever serves it soon sees to."""
    if port is not None:
        clock.wait_until(clock.now() + _PLUGGING, lambda: port.is_symlink() == there)


def behind_packets(options: dict[str, Any], camera: FakeGigE, clock: Clock) -> Instrument:
    """The camera."""

    def fail(kind: str, seconds: float) -> None:
        camera.inject(CameraFault(cast(CameraFaultKind, kind), clock.now(), seconds))

    return Instrument("aravis-camera", options, CAMERA_KINDS, fail, camera.mend)
