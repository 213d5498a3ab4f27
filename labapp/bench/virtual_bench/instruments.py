"""What a served instrument is to others: its driver, the driver's options, and its faults."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from drivers.interfaces import Clock
from labapp.bench.virtual_bench.shared_world import SharedWorld
from simulator.machines.cs2000 import CS2000Machine
from simulator.machines.machine import SerialMachine
from simulator.wire.faults import WIRE_FAULT_KINDS, WireFault
from simulator.wire.line import SimulatedLine
from simulator.wire.pty import PtyLine
from simulator.wire.usb_plug import Plug


@dataclass(frozen=True)
class ServingContext:
    """Context in which instruments are served.

    `shared` is the virtual world, `folder` holds the ports, and leaving `stack` ends the
    instruments.
    """

    shared: SharedWorld
    folder: Path
    stack: ExitStack

    @property
    def clock(self) -> Clock:
        return self.shared.clock


@dataclass(frozen=True)
class ServedInstrument:
    """A served instrument: driver and options for a bench file, and the faults that it can have."""

    driver: str
    options: dict[str, Any]
    fault_kinds: tuple[str, ...] = ()
    inject_fault: Callable[[str, float], None] = field(default=lambda kind, seconds: None)
    """Cause a fault of some kind for some seconds; ValueError for an unknown kind."""
    clear_faults: Callable[[], None] = field(default=lambda: None)


def serve_on_serial_line(
    site: ServingContext, driver: str, machine: SerialMachine, baudrate: int, **options: Any
) -> ServedInstrument:
    """Serve a simulated instrument at a serial port named after its driver."""
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
    """Return a served instrument behind a serial line or a USB plug.

    `own_faults` are the kinds of faults of the machine itself, besides those of the wire.
    """
    port = Path(options["port"]) if "port" in options else None

    def fail(kind: str, seconds: float) -> None:
        wire.inject(WireFault(kind, clock.now(), seconds))
        _wait_for_port(port, kind != "disconnect", clock)

    def mend() -> None:
        wire.clear_faults()
        _wait_for_port(port, True, clock)

    return ServedInstrument(driver, options, (*WIRE_FAULT_KINDS, *own_faults), fail, mend)


def _wait_for_port(port: Path | None, there: bool, clock: Clock) -> None:
    """Wait up to 1 s until another thread has made a port appear or disappear."""
    if port is not None:
        clock.wait_until(clock.now() + 1.0, lambda: port.is_symlink() == there)


def serve_spectroradiometer(site: ServingContext) -> ServedInstrument:
    """Serve a simulated CS-2000 until the site's stack is left."""
    machine = CS2000Machine(site.shared.radiance)
    # A pseudo-terminal has no control lines, so that hardware flow control isn't possible.
    return serve_on_serial_line(site, "cs2000", machine, 115200, rtscts=False)
