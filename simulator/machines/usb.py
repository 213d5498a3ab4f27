"""What a USB instrument of the virtual bench can do: descriptors, transfers in, reports out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol


class Endpoint(NamedTuple):
    """An endpoint of a USB device.

    address: 0x80 is added for the direction to the host. attributes: 2 bulk, 3 interrupt. size:
    largest packet in bytes. interval: as in the endpoint's descriptor.
    """

    address: int
    attributes: int = 3
    size: int = 64
    interval: int = 10


@dataclass(frozen=True)
class UsbDescription:
    """Contents of a USB device's descriptors: one configuration with one interface.

    interface_class: 3 is HID.
    """

    vendor: int
    product: int
    maker: str = ""
    name: str = ""
    serial: str = ""
    release: int = 0x0100
    interface_class: int = 3
    endpoints: Sequence[Endpoint] = field(default=())


class SetupPacket(NamedTuple):
    """Setup packet of a USB control transfer. recipient: wIndex, such as the interface."""

    request_type: int
    request: int
    value: int
    recipient: int
    length: int


class UsbStall(Exception):
    """Raised when a device refuses a transfer."""


class InputReport(NamedTuple):
    """Bytes for the host, ready at a USB endpoint from `at` on, in seconds of the bench's clock."""

    at: float
    endpoint: int
    data: bytes


class UsbMachine(Protocol):
    """A USB instrument, independent of the bus and of the virtual bench.

    own_faults: names of the faults that can occur within it.
    """

    own_faults: tuple[str, ...]
    description: UsbDescription

    def control(self, setup: SetupPacket, data: bytes, t: float) -> tuple[bytes, list[InputReport]]:
        """Carry out a control transfer at time t; return its answer and the reports that follow.

        The time never decreases from call to call. Raises UsbStall if the device refuses.
        """

    def write(self, endpoint: int, data: bytes, t: float) -> list[InputReport]:
        """Give the instrument bytes at an endpoint, and return its reports.

        Raises UsbStall if it refuses them.
        """

    def power_up(self, t: float) -> None:
        """Switch the instrument on at time t, with nothing stored from before."""

    def set_fault(self, kind: str | None) -> None:
        """Begin one of `own_faults`, or end all if `kind` is None."""
