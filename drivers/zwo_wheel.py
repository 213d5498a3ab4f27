"""ZWO filter wheels (EFW) on USB, without ZWO's library.

Source: the protocol that Adam Fritzler observed on the wire of a 7-slot wheel (zwoefw-set, 2023):
HID feature reports of 16 bytes. ZWO hasn't published a protocol.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from typing import NamedTuple

from drivers.errors import DeviceError
from drivers.interfaces import Surroundings
from drivers.usb_wheel import UsbWheel

_SET_REPORT, _GET_REPORT = (0x21, 9, 0x0303), (0xA1, 1, 0x0301)
"""Request type, request and value of the control transfers that send and fetch a report."""

_LENGTH = 16
"""Bytes of a report."""

_REQUEST, _ANSWER = b"\x03\x7e\x5a", b"\x01\x7e\x5a"
_QUERY_STATE, _QUERY_IDENTITY, _TURN_TO_SLOT = b"\x02\x01", b"\x02\x04", b"\x01\x02"


class ZwoStatus(IntEnum):
    """Status byte of the state report, as far as it's used here."""

    IDLE = 1
    FAILED = 6


class _ZwoState(NamedTuple):
    status: int
    error: int
    positions: tuple[int, int, int]
    slots: int

    @property
    def slot(self) -> int:
        """Slot at which the wheel stands; 0 while it turns."""
        stands = self.status == ZwoStatus.IDLE and len(set(self.positions)) == 1
        return self.positions[0] if stands else 0


class ZwoWheel(UsbWheel):
    """Turn a ZWO EFW filter wheel, 03c3:1f01 on USB.

    slots_nm, names, avoid, settling_ms: see drivers.wheel.Wheel. step_ms: longest time from a slot
    to the next. serial: serial number of the wheel, if several are plugged in. both_ways: by
    default the wheel goes forward, slot by slot, because a wheel with this protocol was observed to
    turn forward only and to fail on long ways. Set it true for a wheel that was observed to take
    the shorter way. backend: see drivers.usb_link.backend.
    """

    model = "ZWO EFW filter wheel"
    usb_ids = (0x03C3, 0x1F01)
    _query_time = 4.0

    def __init__(
        self,
        surroundings: Surroundings,
        slots_nm: Sequence[Sequence[float]],
        names: Sequence[str] = (),
        avoid: Sequence[int] = (),
        step_ms: float = 3000.0,
        settling_ms: float = 0.0,
        serial: str = "",
        both_ways: bool = False,
        backend: str = "",
    ) -> None:
        options = (slots_nm, names, avoid, step_ms, settling_ms, serial, backend)
        super().__init__(surroundings, *options)
        if not isinstance(both_ways, bool):
            raise ValueError(f"both_ways is {both_ways!r}; it is true or false")
        self._forward_only = not both_ways
        self._max_leg = 0 if both_ways else 1
        self._name, self._firmware = "", ""

    def health(self) -> dict[str, str]:
        """Return what the wheel reports about itself, by name."""
        self._start_deadline()
        command = "read its state"
        state, again = self._read_state(command), self._read_state(command)
        if state != again:
            raise self._refuse(command, "its answers differ from one to the next", "Ask again")
        return {
            **self._descriptors(),
            "name": self._name,
            "firmware": self._firmware,
            "slots": str(state.slots),
            "slot": str(state.slot) if state.slot else "turning",
            "status": str(state.status),
            "error": str(state.error),
        }

    def _open(self) -> None:
        # On power-up the wheel turns by itself, for which it gets 30 s.
        self._start_deadline(30.0)
        self._read_identity("open")
        self._wait_at_slot("open", 0)

    def _turn_to(self, command: str, number: int) -> None:
        self._send(command, _TURN_TO_SLOT + bytes([number]))
        self._wait_at_slot(command, number)

    def _wait_at_slot(self, command: str, target: int) -> int:
        """Wait until the target slot is reported twice in a row; return the slot.

        target: 0 for any slot.
        """
        agreeing, last = 0, 0
        while True:
            slot = self._read_state(command).slot
            agreeing = agreeing + 1 if slot == last else 1
            last = slot
            if slot and slot == (target or slot) and agreeing >= 2:
                return slot
            if self._clock.now() >= self._deadline:
                state = f"stands at slot {slot}" if slot else "is still turning"
                raise self._refuse(
                    command, f"it {state} after {self._time_granted:.0f} s", _RESTART
                )
            self._pause(0.1)

    def _read_identity(self, command: str) -> None:
        """Read name and firmware; two readings must agree."""
        told = {self._ask(command, _QUERY_IDENTITY) for _ in range(2)}
        if len(told) > 1:
            raise self._invalid_reply_error(command, told.pop())
        data = told.pop()
        self._firmware = ".".join(str(part) for part in data[4:7])
        self._name = data[8:].split(b"\0")[0].decode("ascii", errors="replace")

    def _read_state(self, command: str) -> _ZwoState:
        """Ask for slots and status; DeviceError if the wheel reports a failure."""
        data = self._ask(command, _QUERY_STATE)
        state = _ZwoState(data[4], data[5], (data[6], data[7], data[8]), data[9])
        if state.status == ZwoStatus.FAILED or state.error:
            raise self._refuse(
                command,
                f"it has given up turning (status {state.status}, error {state.error})",
                "See that the wheel turns freely. " + _RESTART,
            )
        if state.slots != len(self._slots):
            raise self._refuse(
                command,
                f"the wheel has {state.slots} slots, slots_nm names {len(self._slots)}",
                "Correct slots_nm",
            )
        if not all(1 <= place <= state.slots for place in state.positions):
            raise self._invalid_reply_error(command, data)
        return state

    def _ask(self, command: str, question: bytes) -> bytes:
        """Send a query; return its reply, which must name the query."""
        self._send(command, question)
        left = self._deadline - self._clock.now()
        # If another length than 17 bytes is requested, the wheel's reply makes no sense.
        data = self._link.control_in(command, *_GET_REPORT, 17, left)
        if len(data) != _LENGTH or data[:4] != _ANSWER + question[1:]:
            raise self._invalid_reply_error(command, data)
        return data

    def _send(self, command: str, question: bytes) -> None:
        report = (_REQUEST + question).ljust(_LENGTH, b"\0")
        left = self._deadline - self._clock.now()
        self._link.control_out(command, *_SET_REPORT, report, left)

    def _invalid_reply_error(self, command: str, data: bytes) -> DeviceError:
        said = data.hex(" ") or "nothing"
        return self._refuse(command, f"it answers {said}, which makes no sense", _RESTART)


_RESTART = "If that stays, pull its plug and put it in again"
