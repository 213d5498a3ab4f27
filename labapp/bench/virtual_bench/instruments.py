"""What is served: an instrument behind its wire, the driver for it, and what it may suffer."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

from drivers.interfaces import Clock
from labapp.bench.virtual_bench.shared_world import SharedWorld
from simulator.machines.machine import SerialMachine
from simulator.wire.camera_faults import CAMERA_FAULT_KINDS as CAMERA_KINDS
from simulator.wire.camera_faults import CameraFault, CameraFaultKind
from simulator.wire.fake_gige import FakeGigECamera
from simulator.wire.faults import WIRE_FAULT_KINDS, WireFault
from simulator.wire.line import SimulatedLine
from simulator.wire.pty import PtyLine
from simulator.wire.usb_plug import Plug

_PORT_TIMEOUT = 1.0
"""Seconds in which a port comes or goes."""


@dataclass(frozen=True)
class ServingContext:
    """Where instruments are served: a world, a folder for their ports, and what ends them."""

    shared: SharedWorld
    folder: Path
    stack: ExitStack

    @property
    def clock(self) -> Clock:
        return self.shared.clock


@dataclass(frozen=True)
class ServedInstrument:
    """One that is served. driver, options: as in a bench file. fault_kinds: of its faults."""

    driver: str
    options: dict[str, Any]
    fault_kinds: tuple[str, ...] = ()
    inject_fault: Callable[[str, float], None] = field(default=lambda kind, seconds: None)
    """Have something go wrong for so many seconds; ValueError for an unknown kind."""
    clear_faults: Callable[[], None] = field(default=lambda: None)


def serve_on_serial_line(
    site: ServingContext, driver: str, machine: SerialMachine, baudrate: int, **options: Any
) -> ServedInstrument:
    """An instrument at a serial port of the driver's name."""
    line, port = SimulatedLine(machine, baudrate=baudrate), site.folder / driver
    site.stack.enter_context(PtyLine(line, port, site.clock))
    return wired_instrument(
        driver, {"port": str(port)} | options, line, machine.own_faults, site.clock
    )


def wired_instrument(
    driver: str,
    options: dict[str, Any],
    wire: SimulatedLine | Plug,
    own_faults: tuple[str, ...],
    clock: Clock,
) -> ServedInstrument:
    """An instrument behind a serial line or a USB plug. own_faults: the machine's own faults."""
    port = Path(options["port"]) if "port" in options else None

    def fail(kind: str, seconds: float) -> None:
        wire.inject(WireFault(kind, clock.now(), seconds))
        _wait_for_port(port, kind != "disconnect", clock)

    def mend() -> None:
        wire.clear_faults()
        _wait_for_port(port, True, clock)

    return ServedInstrument(driver, options, (*WIRE_FAULT_KINDS, *own_faults), fail, mend)


def _wait_for_port(port: Path | None, there: bool, clock: Clock) -> None:
    """Return when a port has come or gone, which whoever serves it soon sees to."""
    if port is not None:
        clock.wait_until(clock.now() + _PORT_TIMEOUT, lambda: port.is_symlink() == there)


def gige_instrument(
    options: dict[str, Any], camera: FakeGigECamera, clock: Clock
) -> ServedInstrument:
    """The camera."""

    def fail(kind: str, seconds: float) -> None:
        camera.inject(CameraFault(cast(CameraFaultKind, kind), clock.now(), seconds))

    return ServedInstrument("aravis-camera", options, CAMERA_KINDS, fail, camera.clear_faults)
