"""A ZWO EFW filter wheel as it is on its USB wire.

Source: the protocol as Adam Fritzler found it on the wire of a wheel of 7 (zwoefw-set, 2023).
"""

from __future__ import annotations

from collections.abc import Callable

from simulator.machines.turning_wheel import TurningWheel
from simulator.machines.usb import Endpoint, InputReport, SetupPacket, UsbDescription, UsbStall

_SET_REPORT, _GET_REPORT = (0x21, 9, 0x0303), (0xA1, 1, 0x0301)
_REQUEST, _ANSWER = b"\x03\x7e\x5a", b"\x01\x7e\x5a"
_LENGTH = 16
_STANDS, _TURNS, _FAILED = 1, 4, 6
_TIMED_OUT = 0x0C


class ZwoWheelMachine:
    """What it is told, and where it stands.

    slots: of the wheel. position: where it stands at first. step: seconds from a slot to the
    next. both_ways: else it turns forward alone, as it was seen to. max_steps: steps of one
    move after which its own controller gives up, 5 as it was seen; 0 for never. on_slot: told
    every slot that comes into the light.
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
        # What its longest answer was lies behind the shorter ones.
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
                # Firmware 3.0.9.
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
        """1, status, error, where it goes, where it left, where it goes, slots, and 4 zeros."""
        wheel = self.wheel
        stands = wheel.reported_slot(t)
        given_up = self._patience * wheel.step
        if not stands and not wheel.never_arrives and self._patience and t > self._begun + given_up:
            self._error = _TIMED_OUT
            wheel.turn_through([], t)
        target, count = wheel.target, wheel.count
        if self._broken or self._error:
            places = bytes([target, wheel.slot_at(t), target])
            return bytes([1, _FAILED, _TIMED_OUT]) + places + bytes([count, 0, 0, 0, 0])
        if stands:
            return bytes([1, _STANDS, 0, stands, stands, stands, count, 0, 0, 0, 0])
        return bytes([1, _TURNS, 0, target, self._start_slot, target, count, 0, 0, 0, 0])
