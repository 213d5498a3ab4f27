"""Effect of cable faults on the packets of a simulated USB device."""

from __future__ import annotations

import random
from collections.abc import Iterable
from typing import NamedTuple

from simulator.wire.faults import WireFault


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
        """Return the host's bytes that reach the device over the faulty USB wire, or None.

        None means that no bytes arrive.
        """
        for fault in faults:
            if fault.kind == "silence" and self._is_drawn(fault):
                return None
            if fault.kind == "bit flips":
                data = self._flip_bits(data, fault.probability)
        return data

    def deliver_to_host(self, packet: Packet, faults: Iterable[WireFault]) -> list[Packet]:
        """Return the packets that reach the host over the faulty USB wire for one that was sent."""
        original = packet.data
        packets = [packet]
        for fault in faults:
            packets = [struck for one in packets for struck in self._apply_fault(one, fault)]
        self._before = original
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
                return [Packet(at, self._chance.randbytes(self._chance.randint(1, len(data) or 1)))]
            case "truncated":
                return [Packet(at, data[: self._chance.randrange(len(data))] if data else data)]
            case "duplicated":
                return [packet, packet]
            case "delayed":
                return [Packet(at + fault.delay, data)]
            case "byte by byte":
                return [Packet(at + 0.005 * i, data[i : i + 1]) for i in range(len(data))]
            case "wrong echo":
                return [Packet(at, self._before)]
        return [packet]

    def _is_drawn(self, fault: WireFault) -> bool:
        return self._chance.random() < fault.probability

    def _flip_bits(self, data: bytes, probability: float) -> bytes:
        return bytes(
            byte ^ (1 << self._chance.randrange(8)) if self._chance.random() < probability else byte
            for byte in data
        )
