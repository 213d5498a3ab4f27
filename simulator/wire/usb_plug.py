"""One simulated USB device where it's plugged in: its presence, its reports, its faults."""

from __future__ import annotations

import errno
import math
import threading
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import TypeVar

import usb.core

from drivers.interfaces import Clock
from simulator.machines.usb import Description, Report, Setup, Stall, UsbMachine
from simulator.wire.faults import WIRE_KINDS, WireFault
from simulator.wire.usb_faults import Noise, Packet

T = TypeVar("T")


def usb_error(code: int) -> Exception:
    """What libusb's backend of pyusb raises."""
    libusb = {errno.ENODEV: -4, errno.EPIPE: -9, errno.EACCES: -3, errno.EBUSY: -6}
    if code == errno.ETIMEDOUT:
        return usb.core.USBTimeoutError("Operation timed out", -7, code)
    return usb.core.USBError(errno.errorcode[code], libusb.get(code, -1), code)


class Plug:
    """A machine in a socket of the bus.

    denied: whether the system lets nobody open it. busy: whether another program has it.
    """

    def __init__(self, machine: UsbMachine, clock: Clock, seed: int) -> None:
        self.machine = machine
        self.denied = self.busy = False
        self.kernel_driver = True
        self.address = 1
        self._clock = clock
        self._noise = Noise(seed)
        # Drivers, faults and those who look come from several threads.
        self._turn = threading.RLock()
        self._faults: list[WireFault] = []
        self._unplugged = 0
        self._there = True
        self._reports: dict[int, list[Packet]] = {}
        self._suffers: str | None = None

    @property
    def description(self) -> Description:
        return self.machine.description

    def inject(self, fault: WireFault) -> None:
        """A fault that begins at its time; ValueError for a kind that it can't have."""
        kinds = (*WIRE_KINDS, *self.machine.own_faults)
        if fault.kind not in kinds:
            raise ValueError(f"kind is {fault.kind!r}; choose {', '.join(kinds)}")
        self._faults.append(fault)

    def mend(self) -> None:
        """No fault any more; what was unplugged is plugged in again."""
        with self._turn:
            self.look()
            self._faults.clear()
            self._unplugged = 0
            self.look()

    def look(self) -> bool:
        """Whether it's there now; lets happen what has happened since."""
        with self._turn:
            now = self._clock.now()
            begun = [f for f in self._faults if f.kind == "disconnect" and f.at <= now]
            if len(begun) != self._unplugged and self._there:
                self._pull()
            self._unplugged = len(begun)
            there = not any(fault.lasts(now) for fault in begun)
            if there and not self._there:
                self._there = True
                self.machine.power(max((f.at + f.seconds for f in begun), default=now))
            suffers = next((f.kind for f in self._lasting if f.kind not in WIRE_KINDS), None)
            if suffers != self._suffers:
                self._suffers = suffers
                self.machine.suffer(suffers)
            return there

    def _pull(self) -> None:
        self._there = False
        # It comes back at another address, and the system takes it again.
        self.address += 1
        self.kernel_driver = True
        self._reports.clear()

    @property
    def _lasting(self) -> list[WireFault]:
        now = self._clock.now()
        return [fault for fault in self._faults if fault.lasts(now)]

    def control(self, setup: Setup, data: bytes, timeout: float) -> bytes:
        """A control transfer; the bytes that the device gives."""
        with self._turn:
            late = self._clock.now() + timeout
            answer, reports = self._taken(data, late, lambda heard: self._handled(setup, heard))
            self._lay_ready(reports)
            if not setup.request_type & 0x80:
                return b""
            packets = self._noise.sent(Packet(self._clock.now(), answer), self._lasting)
            if not packets or packets[0].at > late:
                raise self._silence(late)
            self._wait(packets[0].at)
            return packets[0].data[: setup.length]

    def _handled(self, setup: Setup, data: bytes) -> tuple[bytes, list[Report]]:
        if setup.request_type == 0x80 and setup.request == 6:
            return _descriptor(self.description, setup.value), []
        return self.machine.control(setup, data, self._clock.now())

    def write(self, endpoint: int, data: bytes, timeout: float) -> int:
        """Bytes for an endpoint, all or none."""
        with self._turn:
            late, now = self._clock.now() + timeout, self._clock.now
            out = self.machine.out
            self._lay_ready(self._taken(data, late, lambda heard: out(endpoint, heard, now())))
            return len(data)

    def _taken(self, data: bytes, late: float, take: Callable[[bytes], T]) -> T:
        """What the device makes of bytes, as noise lets it hear them."""
        self.require_there()
        heard = self._noise.heard(data, self._lasting)
        if heard is None:
            raise self._silence(late)
        try:
            return take(heard)
        except Stall:
            raise usb_error(errno.EPIPE) from None

    def read(self, endpoint: int, length: int, timeout: float) -> bytes:
        """The next report, within `timeout` seconds."""
        with self._turn:
            late = self._clock.now() + timeout
            self.require_there()
            waiting = self._reports.get(endpoint, [])
            if not waiting or waiting[0].at > late:
                raise self._silence(late)
            self._wait(waiting[0].at)
            data = waiting.pop(0).data
            if len(data) > length:
                raise usb_error(errno.EOVERFLOW)
            return data

    def _lay_ready(self, reports: Sequence[Report]) -> None:
        for report in reports:
            waiting = self._reports.setdefault(report.endpoint, [])
            waiting += self._noise.sent(Packet(report.at, report.data), self._lasting)
            waiting.sort(key=lambda packet: packet.at)

    def require_there(self) -> None:
        if not self.look():
            raise usb_error(errno.ENODEV)

    def _silence(self, late: float) -> Exception:
        self._wait(late)
        return usb_error(errno.ETIMEDOUT)

    def _wait(self, time: float) -> None:
        """Until then, unless it is unplugged before."""
        now = self._clock.now()
        pulled = [f.at for f in self._faults if f.kind == "disconnect" and now < f.at <= time]
        end = min(pulled, default=math.inf)
        self._clock.wait_until(min(time, end), lambda: False)
        self.require_there()


def _descriptor(description: Description, value: int) -> bytes:
    """A string of the device, as the USB specification packs it."""
    kind, index = value >> 8, value & 0xFF
    if kind != 3:
        raise Stall
    if index == 0:
        return b"\x04\x03\x09\x04"
    strings = (description.maker, description.name, description.serial)
    if index > len(strings) or not strings[index - 1]:
        raise Stall
    text = strings[index - 1].encode("utf-16-le")
    return bytes([len(text) + 2, 3]) + text


def device_descriptor(description: Description, port: int, address: int) -> SimpleNamespace:
    """The fields that pyusb reads, as libusb names them."""
    strings = (description.maker, description.name, description.serial)
    indices = [index if said else 0 for index, said in enumerate(strings, start=1)]
    return SimpleNamespace(
        bLength=18,
        bDescriptorType=1,
        bcdUSB=0x0110,
        bDeviceClass=0,
        bDeviceSubClass=0,
        bDeviceProtocol=0,
        bMaxPacketSize0=8,
        idVendor=description.vendor,
        idProduct=description.product,
        bcdDevice=description.release,
        iManufacturer=indices[0],
        iProduct=indices[1],
        iSerialNumber=indices[2],
        bNumConfigurations=1,
        bus=1,
        address=address,
        port_number=port,
        port_numbers=(port,),
        speed=2,
    )
