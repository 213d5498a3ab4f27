"""A Starlight Xpress filter wheel behind its USB wire.

Source: "Handbook for the SX Universal Filter Wheel" (2009), Communication Protocols.
"""

from __future__ import annotations

from collections.abc import Callable

from simulator.machines.turning_wheel import TurningWheel
from simulator.machines.usb import Endpoint, InputReport, SetupPacket, UsbDescription, UsbStall


class StarlightWheelMachine:
    """Simulate a Starlight Xpress filter wheel: its reports and its turning.

    slots: number of slots, 1 to 127. position: first slot in the light. step: seconds from a slot
    to the next. slots_known: whether the wheel has counted its slots; it forgets the number without
    power. on_slot: called with every slot that comes into the light.
    """

    own_faults: tuple[str, ...] = ("busy forever", "stuck", "stall")

    def __init__(
        self,
        slots: int = 7,
        position: int = 1,
        step: float = 0.5,
        slots_known: bool = True,
        serial: str = "",
        on_slot: Callable[[int], None] | None = None,
    ) -> None:
        self.description = UsbDescription(
            0x1278,
            0x0920,
            "Starlight Xpress",
            "SX Filter Wheel",
            serial,
            endpoints=(Endpoint(0x81, size=2), Endpoint(0x01, size=2)),
        )
        self.wheel = TurningWheel(slots, position, step, on_slot=on_slot)
        self._counted = slots_known
        self._counting = False
        self._stalled = False

    def control(self, setup: SetupPacket, data: bytes, t: float) -> tuple[bytes, list[InputReport]]:
        # The only request is HID's SET_REPORT of the output report.
        if self._stalled or setup[:3] != (0x21, 9, 0x0200):
            raise UsbStall
        return b"", self.write(0x01, data, t)

    def write(self, endpoint: int, data: bytes, t: float) -> list[InputReport]:
        """Take the two bytes of an output report, from the control or the output endpoint."""
        if self._stalled or len(data) != 2:
            raise UsbStall
        known = self._slot_count(t)
        if data == b"\x00\x01":
            self._start_counting(t)
            known = 0
        elif data[0] and not self._counting:
            # By the handbook, a number above the last slot means the last slot.
            self.wheel.turn_to(min(data[0], self.wheel.count), t)
        # The input report is ready a millisecond later.
        return [InputReport(t + 0.001, 0x81, bytes([self.wheel.reported_slot(t), known]))]

    def power_up(self, t: float) -> None:
        self._counted = self._counting = False
        self._start_counting(t)

    def set_fault(self, kind: str | None) -> None:
        self._stalled = kind == "stall"
        self.wheel.never_arrives = kind == "busy forever"
        self.wheel.stuck = kind == "stuck"

    def _start_counting(self, t: float) -> None:
        """Turn once around and on to the first slot: one to two rotations, by the handbook."""
        count, at = self.wheel.count, self.wheel.slot_at(t)
        around = [(at - 1 + i) % count + 1 for i in range(1, count + 1)]
        home = [slot % count + 1 for slot in range(at, count + 1)] if at > 1 else []
        self._counting, self._counted = True, False
        self.wheel.turn_through([*around, *home], t)

    def _slot_count(self, t: float) -> int:
        if self._counting and self.wheel.reported_slot(t):
            self._counting, self._counted = False, True
        return self.wheel.count if self._counted else 0
