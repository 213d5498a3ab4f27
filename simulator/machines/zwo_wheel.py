"""A ZWO EFW filter wheel behind its USB wire.

Source: the protocol that Adam Fritzler observed on the wire of a 7-slot wheel (zwoefw-set, 2023).
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum

from simulator.machines.turning_wheel import TurningWheel
from simulator.machines.usb import Endpoint, InputReport, SetupPacket, UsbDescription, UsbStall

_SET_REPORT, _GET_REPORT = (0x21, 9, 0x0303), (0xA1, 1, 0x0301)
_REQUEST, _ANSWER = b"\x03\x7e\x5a", b"\x01\x7e\x5a"

_LENGTH = 16
"""Bytes of a report."""


class SimulatedZwoStatus(IntEnum):
    """Status byte of a ZWO wheel's state report."""

    STANDS = 1
    TURNS = 4
    FAILED = 6


class ZwoWheelMachine:
    """Simulate a ZWO EFW filter wheel: its reports and its turning.

    slots: number of slots. position: first slot in the light. step: seconds from a slot to the
    next. both_ways: whether the wheel takes the shorter way; real wheels were observed to turn
    forward only. max_steps: number of steps of one move after which the wheel's controller gives
    up, 0 for never; 5 was observed. on_slot: called with every slot that comes into the light.
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
        timed_out = 0x0C
        wheel = self.wheel
        stands = wheel.reported_slot(t)
        given_up = self._patience * wheel.step
        if not stands and not wheel.never_arrives and self._patience and t > self._begun + given_up:
            self._error = timed_out
            wheel.turn_through([], t)
        target, count = wheel.target, wheel.count
        if self._broken or self._error:
            places = bytes([target, wheel.slot_at(t), target])
            failed = bytes([1, SimulatedZwoStatus.FAILED, timed_out])
            return failed + places + bytes([count, 0, 0, 0, 0])
        if stands:
            status = SimulatedZwoStatus.STANDS
            return bytes([1, status, 0, stands, stands, stands, count, 0, 0, 0, 0])
        status = SimulatedZwoStatus.TURNS
        return bytes([1, status, 0, target, self._start_slot, target, count, 0, 0, 0, 0])
