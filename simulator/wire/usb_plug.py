"""One USB device in its socket: its presence, reports and faults."""

from __future__ import annotations

import errno
import math
import random
import threading
from collections.abc import Callable, Iterable, Sequence
from types import SimpleNamespace
from typing import NamedTuple, TypeVar

import usb.core

from drivers.interfaces import Clock
from simulator.machines.usb import InputReport, SetupPacket, UsbDescription, UsbMachine, UsbStall
from simulator.wire.faults import WIRE_FAULT_KINDS, WireFault


class Packet(NamedTuple):
    """Bytes of a USB transfer that are ready for the host from `at` on."""

    at: float
    data: bytes


class PacketFaults:
    """Apply the faults of one USB device's cable to packets, when the device sends them.

    Faults of the device itself have no effect here.
    """

    def __init__(self, seed: int) -> None:
        self._chance = random.Random(seed)
        self._before = b""

    def deliver_to_device(self, data: bytes, faults: Iterable[WireFault]) -> bytes | None:
        """Return what reaches the device of the host's bytes, or None if nothing arrives."""
        for fault in faults:
            if fault.kind == "silence" and self._is_drawn(fault):
                return None
            if fault.kind == "bit flips":
                data = self._flip_bits(data, fault.probability)
        return data

    def deliver_to_host(self, packet: Packet, faults: Iterable[WireFault]) -> list[Packet]:
        """Return the packets that reach the host for one that was sent."""
        packets = [packet]
        for fault in faults:
            packets = [struck for one in packets for struck in self._apply_fault(one, fault)]
        self._before = packet.data
        return packets

    def _apply_fault(self, packet: Packet, fault: WireFault) -> list[Packet]:
        at, data = packet
        if fault.kind == "bit flips":
            return [Packet(at, self._flip_bits(data, fault.probability))]
        if not self._is_drawn(fault):
            return [packet]
        match fault.kind:
            case "silence" | "mute":
                return []
            case "garbage":
                data = self._chance.randbytes(self._chance.randint(1, len(data) or 1))
            case "truncated" if data:
                data = data[: self._chance.randrange(len(data))]
            case "duplicated":
                return [packet, packet]
            case "delayed":
                at += fault.delay
            case "byte by byte":
                return [Packet(at + 0.005 * i, data[i : i + 1]) for i in range(len(data))]
            case "wrong echo":
                data = self._before
        return [Packet(at, data)]

    def _is_drawn(self, fault: WireFault) -> bool:
        return self._chance.random() < fault.probability

    def _flip_bits(self, data: bytes, probability: float) -> bytes:
        return bytes(
            byte ^ (1 << self._chance.randrange(8)) if self._chance.random() < probability else byte
            for byte in data
        )


T = TypeVar("T")


def usb_error(code: int) -> Exception:
    """Return the error that pyusb's libusb backend raises for an errno."""
    libusb = {errno.ENODEV: -4, errno.EPIPE: -9, errno.EACCES: -3, errno.EBUSY: -6}
    if code == errno.ETIMEDOUT:
        return usb.core.USBTimeoutError("Operation timed out", -7, code)
    return usb.core.USBError(errno.errorcode[code], libusb.get(code, -1), code)


class Plug:
    """Connect a USB machine to a socket of the simulated bus.

    denied: whether the system refuses to open the device. busy: whether another program uses it.
    """

    def __init__(self, machine: UsbMachine, clock: Clock, seed: int) -> None:
        self.machine, self._clock, self._noise = machine, clock, PacketFaults(seed)
        self.denied = self.busy = False
        self.kernel_driver, self.address = True, 1
        # Drivers and the bench, which adds and checks faults, call from several threads.
        self._turn = threading.RLock()
        self._faults: list[WireFault] = []
        self._disconnect_count, self._is_plugged_in = 0, True
        self._reports: dict[int, list[Packet]] = {}
        self._machine_fault: str | None = None

    @property
    def description(self) -> UsbDescription:
        return self.machine.description

    def inject(self, fault: WireFault) -> None:
        """Add a fault of the cable or its device.

        Raises ValueError for an unknown kind.
        """
        kinds = (*WIRE_FAULT_KINDS, *self.machine.own_faults)
        if fault.kind not in kinds:
            raise ValueError(f"kind is {fault.kind!r}; choose {', '.join(kinds)}")
        self._faults.append(fault)

    def clear_faults(self) -> None:
        """Remove all faults, and plug the cable in again."""
        with self._turn:
            self.update_presence()
            self._faults.clear()
            self._disconnect_count = 0
            self.update_presence()

    def update_presence(self) -> bool:
        """Unplug the cable and begin faults when due; return whether it is plugged in."""
        with self._turn:
            now = self._clock.now()
            begun = [f for f in self._faults if f.kind == "disconnect" and f.at <= now]
            if len(begun) != self._disconnect_count and self._is_plugged_in:
                self._is_plugged_in = False
                # The device returns at another address, and the system's driver claims it again.
                self.address += 1
                self.kernel_driver = True
                self._reports.clear()
            self._disconnect_count = len(begun)
            there = not any(fault.is_active(now) for fault in begun)
            if there and not self._is_plugged_in:
                self._is_plugged_in = True
                self.machine.power_up(max((f.at + f.seconds for f in begun), default=now))
            own = [f.kind for f in self._active_faults if f.kind not in WIRE_FAULT_KINDS]
            suffers = own[0] if own else None
            if suffers != self._machine_fault:
                self._machine_fault = suffers
                self.machine.set_fault(suffers)
            return there

    @property
    def _active_faults(self) -> list[WireFault]:
        now = self._clock.now()
        return [fault for fault in self._faults if fault.is_active(now)]

    def control(self, setup: SetupPacket, data: bytes, timeout: float) -> bytes:
        """Carry out a control transfer, and return the answer."""

        def handle(heard: bytes) -> tuple[bytes, list[InputReport]]:
            if setup.request_type == 0x80 and setup.request == 6:
                return _descriptor(self.description, setup.value), []
            return self.machine.control(setup, heard, self._clock.now())

        with self._turn:
            late = self._clock.now() + timeout
            answer, reports = self._deliver(data, late, handle)
            self._queue_reports(reports)
            if not setup.request_type & 0x80:
                return b""
            sent = Packet(self._clock.now(), answer)
            packets = self._noise.deliver_to_host(sent, self._active_faults)
            if not packets or packets[0].at > late:
                raise self._timeout_error(late)
            self._wait(packets[0].at)
            return packets[0].data[: setup.length]

    def write(self, endpoint: int, data: bytes, timeout: float) -> int:
        """Write bytes to an endpoint, and return their number."""

        def handle(heard: bytes) -> list[InputReport]:
            return self.machine.write(endpoint, heard, self._clock.now())

        with self._turn:
            self._queue_reports(self._deliver(data, self._clock.now() + timeout, handle))
            return len(data)

    def _deliver(self, data: bytes, late: float, handler: Callable[[bytes], T]) -> T:
        """Bring bytes to the device, as faults change them, and return the handler's result."""
        self.require_plugged_in()
        heard = self._noise.deliver_to_device(data, self._active_faults)
        if heard is None:
            raise self._timeout_error(late)
        try:
            return handler(heard)
        except UsbStall:
            raise usb_error(errno.EPIPE) from None

    def read(self, endpoint: int, length: int, timeout: float) -> bytes:
        """Read the device's next report, within `timeout` seconds."""
        with self._turn:
            late = self._clock.now() + timeout
            self.require_plugged_in()
            waiting = self._reports.get(endpoint, [])
            if not waiting or waiting[0].at > late:
                raise self._timeout_error(late)
            self._wait(waiting[0].at)
            data = waiting.pop(0).data
            if len(data) > length:
                raise usb_error(errno.EOVERFLOW)
            return data

    def _queue_reports(self, reports: Sequence[InputReport]) -> None:
        for report in reports:
            waiting = self._reports.setdefault(report.endpoint, [])
            sent = Packet(report.at, report.data)
            waiting += self._noise.deliver_to_host(sent, self._active_faults)
            waiting.sort(key=lambda packet: packet.at)

    def require_plugged_in(self) -> None:
        if not self.update_presence():
            raise usb_error(errno.ENODEV)

    def _timeout_error(self, late: float) -> Exception:
        self._wait(late)
        return usb_error(errno.ETIMEDOUT)

    def _wait(self, time: float) -> None:
        """Wait until a time of the bench's clock, or raise an error if the cable is pulled."""
        now = self._clock.now()
        pulled = [f.at for f in self._faults if f.kind == "disconnect" and now < f.at <= time]
        end = min(pulled, default=math.inf)
        self._clock.wait_until(min(time, end), lambda: False)
        self.require_plugged_in()


def _descriptor(description: UsbDescription, value: int) -> bytes:
    """Return a string descriptor, packed as the USB specification says."""
    kind, index = value >> 8, value & 0xFF
    if kind != 3:
        raise UsbStall
    if index == 0:
        return b"\x04\x03\x09\x04"
    strings = (description.maker, description.name, description.serial)
    if index > len(strings) or not strings[index - 1]:
        raise UsbStall
    text = strings[index - 1].encode("utf-16-le")
    return bytes([len(text) + 2, 3]) + text


def device_descriptor(description: UsbDescription, port: int, address: int) -> SimpleNamespace:
    """Return a device's descriptor as pyusb reads it, with fields named as in libusb."""
    strings = (description.maker, description.name, description.serial)
    indices = [index if said else 0 for index, said in enumerate(strings, start=1)]
    return SimpleNamespace(
        bLength=18, bDescriptorType=1, bcdUSB=0x0110, bDeviceClass=0, bDeviceSubClass=0,
        bDeviceProtocol=0, bMaxPacketSize0=8, idVendor=description.vendor,
        idProduct=description.product, bcdDevice=description.release, iManufacturer=indices[0],
        iProduct=indices[1], iSerialNumber=indices[2], bNumConfigurations=1, bus=1,
        address=address, port_number=port, port_numbers=(port,), speed=2,
    )  # fmt: skip
