"""Filter wheels behind their USB wires: their turning, and a Starlight Xpress and a ZWO EFW wheel.

Sources: "Handbook for the SX Universal Filter Wheel" (2009), Communication Protocols; the protocol
that Adam Fritzler observed on the wire of a 7-slot EFW (zwoefw-set, 2023).
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum

from simulator.machines.usb import Endpoint, InputReport, SetupPacket, UsbDescription, UsbStall


class TurningWheel:
    """Simulate a filter wheel of `count` slots that needs `step` seconds per slot.

    both_ways: whether the wheel takes the shorter way; otherwise it turns forward only. on_slot:
    called with every slot that comes into the light. Times never decrease from call to call.
    """

    def __init__(
        self,
        count: int,
        position: int = 1,
        step: float = 0.5,
        both_ways: bool = True,
        on_slot: Callable[[int], None] | None = None,
    ) -> None:
        if count < 1 or not 1 <= position <= count:
            raise ValueError(f"position is {position} of {count}; count from 1")
        if not step > 0:
            raise ValueError(f"step is {step}; it must be greater than 0")
        self.count, self.step, self.both_ways = count, step, both_ways
        self.stuck = self.never_arrives = False
        self._turned = on_slot or (lambda slot: None)
        self._at, self.target = position, position
        self._way: list[int] = []
        self._since = 0.0

    def turn_to(self, slot: int, t: float) -> None:
        """Begin to turn to a slot; a wheel that is turning goes on from its present slot."""
        self.turn_through(shorter_path(self.slot_at(t), slot, self.count, self.both_ways), t)

    def turn_through(self, way: list[int], t: float) -> None:
        """Begin to turn through a list of slots."""
        if self.stuck:
            return
        self._way, self._since = way, t
        self.target = way[-1] if way else self._at

    def jump_to(self, slot: int, t: float) -> None:
        """Put the wheel at a slot without turning."""
        self._way, self._since, self._at, self.target = [], t, slot, slot
        self._turned(slot)

    def slot_at(self, t: float) -> int:
        """Return the slot that is in the light, or was the last to be."""
        while self._way and not self.stuck and t >= self._since + self.step:
            self._since += self.step
            self._at = self._way.pop(0)
            self._turned(self._at)
        return self._at

    def resting_slot(self, t: float) -> int:
        """Return the slot at which the wheel really stands; 0 while it turns."""
        at = self.slot_at(t)
        return 0 if self._way and not self.stuck else at

    def reported_slot(self, t: float) -> int:
        """Return the slot that the wheel reports; 0 if it says that it turns."""
        at = self.resting_slot(t)
        return 0 if self.never_arrives else at


def shorter_path(start: int, end: int, count: int, both_ways: bool = True) -> list[int]:
    """Return the slots that a wheel passes on its shorter way.

    The wheel turns forward if both ways are equally long, or if `both_ways` is false.
    """
    ahead = (end - start) % count
    back = count - ahead
    steps, sign = (ahead, 1) if not both_ways or ahead <= back else (back, -1)
    return [(start - 1 + sign * i) % count + 1 for i in range(1, steps + 1)]


class StarlightWheelMachine:
    """Simulate a Starlight Xpress filter wheel: its reports and its turning.

    slots: 1 to 127. step: seconds from a slot to the next. slots_known: whether the wheel has
    counted its slots, whose number it forgets without power. on_slot: called with every slot that
    comes into the light.
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
        ends = Endpoint(0x81, size=2), Endpoint(0x01, size=2)
        self.description = UsbDescription(
            0x1278, 0x0920, "Starlight Xpress", "SX Filter Wheel", serial, endpoints=ends
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


_SET_REPORT, _GET_REPORT = (0x21, 9, 0x0303), (0xA1, 1, 0x0301)
_REQUEST, _ANSWER = b"\x03\x7e\x5a", b"\x01\x7e\x5a"

_LENGTH = 16  # bytes of a report


class SimulatedZwoStatus(IntEnum):
    """Status byte of a ZWO wheel's state report."""

    STANDS = 1
    TURNS = 4
    FAILED = 6


class ZwoWheelMachine:
    """Simulate a ZWO EFW filter wheel: its reports and its turning.

    step: seconds from a slot to the next. both_ways: whether the wheel takes the shorter way; real
    wheels were observed to turn forward only. max_steps: of one move after which the controller
    gives up, 0 for never; 5 was observed. on_slot: called with every slot that comes into the
    light.
    """

    own_faults: tuple[str, ...] = ("busy forever", "stuck", "error code", "stall")

    def __init__(
        self,
        slots: int = 7,
        position: int = 1,
        step: float = 1.0,
        both_ways: bool = False,
        max_steps: int = 5,
        name: str = "EFW-S-0",
        serial: str = "",
        on_slot: Callable[[int], None] | None = None,
    ) -> None:
        self.description = UsbDescription(
            0x03C3, 0x1F01, "ZWO", "EFW", serial, endpoints=(Endpoint(0x81, size=16),)
        )
        self.wheel = TurningWheel(slots, position, step, both_ways, on_slot)
        self._name = name.encode("ascii")[:7]
        self._patience = max_steps
        self._start_slot = position
        self._begun, self._error = 0.0, 0
        self._broken = self._stalled = False
        # A short reply overwrites only the beginning, so the end of a longer one remains behind it.
        self._answer = bytearray(_LENGTH)

    def control(self, setup: SetupPacket, data: bytes, t: float) -> tuple[bytes, list[InputReport]]:
        if self._stalled:
            raise UsbStall
        if setup[:3] == _SET_REPORT and len(data) == _LENGTH and data[:3] == _REQUEST:
            self._execute(data[3:5], data[5], t)
            return b"", []
        if setup[:3] == _GET_REPORT:
            return bytes(self._answer[: setup.length]), []
        raise UsbStall

    def write(self, endpoint: int, data: bytes, t: float) -> list[InputReport]:
        raise UsbStall

    def power_up(self, t: float) -> None:
        self._error = 0
        self._answer[:] = bytes(_LENGTH)
        self.wheel.turn_through([], t)
        self.wheel.jump_to(self.wheel.slot_at(t), t)
        self._start_slot = self.wheel.slot_at(t)

    def set_fault(self, kind: str | None) -> None:
        self._stalled = kind == "stall"
        self._broken = kind == "error code"
        self.wheel.never_arrives = kind == "busy forever"
        self.wheel.stuck = kind == "stuck"

    def _execute(self, command: bytes, number: int, t: float) -> None:
        match command:
            case b"\x02\x04":
                # The numbers 3, 0, 9 are the firmware's version.
                self._set_reply(b"\x04\x03\x00\x09\x00" + self._name.ljust(8, b"\0"))
            case b"\x02\x01":
                self._set_reply(self._encode_state(t))
            case b"\x01\x02" if 1 <= number <= self.wheel.count and not self._error:
                self._start_slot, self._begun = self.wheel.slot_at(t), t
                self.wheel.turn_to(number, t)

    def _set_reply(self, words: bytes) -> None:
        said = _ANSWER + words
        self._answer[: len(said)] = said

    def _encode_state(self, t: float) -> bytes:
        """Return the state report.

        Its bytes are 1, status, error, target, start, target, number of slots, and 4 zeros.
        """
        wheel, timed_out = self.wheel, 0x0C
        stands = wheel.reported_slot(t)
        given_up = self._patience * wheel.step
        if not stands and not wheel.never_arrives and self._patience and t > self._begun + given_up:
            self._error = timed_out
            wheel.turn_through([], t)
        error, target, start = 0, wheel.target, self._start_slot
        status = SimulatedZwoStatus.TURNS
        if self._broken or self._error:
            status, error, start = SimulatedZwoStatus.FAILED, timed_out, wheel.slot_at(t)
        elif stands:
            status, target, start = SimulatedZwoStatus.STANDS, stands, stands
        return bytes([1, status, error, target, start, target, wheel.count, 0, 0, 0, 0])
