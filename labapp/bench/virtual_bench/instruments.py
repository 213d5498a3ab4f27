"""What is served: an instrument behind its wire, the driver for it, and what it may suffer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from drivers.interfaces import Clock
from simulator.wire.camera_faults import KINDS as CAMERA_KINDS
from simulator.wire.camera_faults import CameraFault
from simulator.wire.fake_gige import FakeGigE
from simulator.wire.faults import WIRE_KINDS, WireFault

_PLUGGING = 1.0
"""Seconds in which a port comes or goes."""


class Wire(Protocol):
    """A line or a USB plug."""

    def inject(self, fault: WireFault) -> None: ...

    def mend(self) -> None: ...


@dataclass(frozen=True)
class Instrument:
    """One that is served. driver, options: as in a bench file. kinds: of its faults."""

    driver: str
    options: dict[str, Any]
    kinds: tuple[str, ...] = ()
    fail: Callable[[str, float], None] = field(default=lambda kind, seconds: None)
    """Have something go wrong for so many seconds; ValueError for an unknown kind."""
    mend: Callable[[], None] = field(default=lambda: None)


def on_a_wire(
    driver: str, options: dict[str, Any], wire: Wire, own: tuple[str, ...], clock: Clock
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
        if kind not in CAMERA_KINDS:
            raise ValueError(f"kind is {kind!r}; choose {', '.join(CAMERA_KINDS)}")
        known = {one: one for one in CAMERA_KINDS}
        camera.inject(CameraFault(known[kind], clock.now(), seconds))

    return Instrument("aravis-camera", options, CAMERA_KINDS, fail, camera.mend)
