"""A Starlight Xpress filter wheel as it is on its USB wire.

Source: "Handbook for the SX Universal Filter Wheel" (2009), Communication Protocols.
"""

from __future__ import annotations

from collections.abc import Callable

from simulator.machines.turning_wheel import TurningWheel
from simulator.machines.usb import Endpoint, InputReport, SetupPacket, UsbDescription, UsbStall

_SET_REPORT = (0x21, 9, 0x0200)
_IN = 0x81
_LATENCY = 0.001


class StarlightWheelMachine:
    """What it is told, and where it stands.

    slots: 1 to 127. position: where it stands at first. step: seconds from a slot to the next.
    slots_known: whether it knows how many it has; it forgets that with its power. on_slot: told
    every slot that comes into the light.
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
            endpoints=(Endpoint(_IN, size=2), Endpoint(0x01, size=2)),
        )
        self.wheel = TurningWheel(slots, position, step, on_slot=on_slot)
        self._counted = slots_known
        self._counting = False
        self._stalled = False

    def control(self, setup: SetupPacket, data: bytes, t: float) -> tuple[bytes, list[InputReport]]:
        if self._stalled or setup[:3] != _SET_REPORT:
            raise UsbStall
        return b"", self.write(0x01, data, t)

    def write(self, endpoint: int, data: bytes, t: float) -> list[InputReport]:
        """The two bytes of an output report, which may come by its own endpoint, too."""
        if self._stalled or len(data) != 2:
            raise UsbStall
        known = self._slot_count(t)
        if data == b"\x00\x01":
            self._start_counting(t)
            known = 0
        elif data[0] and not self._counting:
            # More than it has is its last, says the handbook.
            self.wheel.turn_to(min(data[0], self.wheel.count), t)
        return [InputReport(t + _LATENCY, _IN, bytes([self.wheel.reported_slot(t), known]))]

    def power_up(self, t: float) -> None:
        self._counted = self._counting = False
        self._start_counting(t)

    def set_fault(self, kind: str | None) -> None:
        self._stalled = kind == "stall"
        self.wheel.never_arrives = kind == "busy forever"
        self.wheel.stuck = kind == "stuck"

    def _start_counting(self, t: float) -> None:
        """Turn around, and on to the first slot: the handbook says one to two rotations."""
        count, at = self.wheel.count, self.wheel.slot_at(t)
        around = [(at - 1 + i) % count + 1 for i in range(1, count + 1)]
        home = [slot % count + 1 for slot in range(at, count + 1)] if at > 1 else []
        self._counting, self._counted = True, False
        self.wheel.turn_through([*around, *home], t)

    def _slot_count(self, t: float) -> int:
        if self._counting and self.wheel.reported_slot(t):
            self._counting, self._counted = False, True
        return self.wheel.count if self._counted else 0
