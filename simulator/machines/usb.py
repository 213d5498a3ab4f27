"""What a simulated USB device is: descriptors, transfers in, reports out, and the time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol


class Endpoint(NamedTuple):
    """address: with 0x80 for to the host. attributes: 2 bulk, 3 interrupt. size: of a packet."""

    address: int
    attributes: int = 3
    size: int = 64
    interval: int = 10


@dataclass(frozen=True)
class UsbDescription:
    """What a device's descriptors say: one configuration of one interface (class 3: HID)."""

    vendor: int
    product: int
    maker: str = ""
    name: str = ""
    serial: str = ""
    release: int = 0x0100
    interface_class: int = 3
    endpoints: Sequence[Endpoint] = field(default=())


class SetupPacket(NamedTuple):
    """The request of a control transfer. recipient: wIndex, such as the interface."""

    request_type: int
    request: int
    value: int
    recipient: int
    length: int


class UsbStall(Exception):
    """A device refuses a transfer."""


class InputReport(NamedTuple):
    """Bytes for the host that lie ready at an endpoint from `at` on, in the bench's seconds."""

    at: float
    endpoint: int
    data: bytes


class UsbMachine(Protocol):
    """An instrument that knows neither the bus nor worlds.

    own_faults: what can go wrong within it, in words.
    """

    own_faults: tuple[str, ...]
    description: UsbDescription

    def control(self, setup: SetupPacket, data: bytes, t: float) -> tuple[bytes, list[InputReport]]:
        """A control transfer at t, which never goes back: its answer, and reports; UsbStall."""
        ...

    def write(self, endpoint: int, data: bytes, t: float) -> list[InputReport]:
        """Bytes from the host to a bulk or interrupt endpoint; UsbStall."""
        ...

    def power_up(self, t: float) -> None:
        """It gets power: whatever it knew or did before is gone."""
        ...

    def set_fault(self, kind: str | None) -> None:
        """One of `own_faults` begins, or (None) all of them end."""
        ...
