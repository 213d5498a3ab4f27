"""Filter wheels of ZWO (EFW), by USB and without ZWO's library.

Source: the protocol as Adam Fritzler found it on the wire of a wheel of 7 (zwoefw-set, 2023):
HID feature reports of 16 bytes. ZWO has published none.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from drivers.errors import DeviceError
from drivers.interfaces import Surroundings
from drivers.usb_wheel import UsbWheel

VENDOR, PRODUCT = 0x03C3, 0x1F01

_SET_REPORT = (0x21, 9, 0x0303)
_GET_REPORT = (0xA1, 1, 0x0301)
_LENGTH = 16
_ASKED = 17
"""Bytes to ask for: with another length it answers what makes no sense."""

_REQUEST, _ANSWER = b"\x03\x7e\x5a", b"\x01\x7e\x5a"
_WHERE, _WHO, _GO = b"\x02\x01", b"\x02\x04", b"\x01\x02"
_STANDS, _FAILED = 1, 6

_POLL = 0.1
_AGREEING = 2
_STARTING = 30.0
"""Seconds for the wheel's own turning when it gets power."""


class _State(NamedTuple):
    status: int
    error: int
    places: tuple[int, int, int]
    slots: int

    @property
    def slot(self) -> int:
        """Where it stands; 0 while it doesn't."""
        stands = self.status == _STANDS and len(set(self.places)) == 1
        return self.places[0] if stands else 0


class ZwoWheel(UsbWheel):
    """A ZWO EFW filter wheel: 03c3:1f01.

    slots_nm, names, avoid, settling_ms: see drivers.wheel.Wheel. step_ms: the most that it needs
    from a slot to the next. serial: of the wheel, where several are plugged in. both_ways: told
    by this protocol, a wheel was seen to turn forward alone and to fail on long ways; so it goes
    forward, slot by slot. Set it true for one that was seen to take the shorter way. backend:
    see drivers.usb_link.backend.
    """

    model = "ZWO EFW filter wheel"
    usb = (VENDOR, PRODUCT)
    _answers = 4.0

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
        self._longest = 0 if both_ways else 1
        self._name, self._firmware = "", ""

    def health(self) -> dict[str, str]:
        """What the wheel tells about itself."""
        self._begin()
        command = "read its state"
        state, again = self._state(command), self._state(command)
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
        self._begin(_STARTING)
        self._who("open")
        self._settle("open", 0)

    def _go(self, command: str, number: int) -> None:
        self._send(command, _GO + bytes([number]))
        self._settle(command, number)

    def _settle(self, command: str, wanted: int) -> int:
        """The slot, once it stands there (0: anywhere), as it says twice."""
        agreeing, last = 0, 0
        while True:
            slot = self._state(command).slot
            agreeing = agreeing + 1 if slot == last else 1
            last = slot
            if slot and slot == (wanted or slot) and agreeing >= _AGREEING:
                return slot
            if self._clock.now() >= self._late:
                state = f"stands at slot {slot}" if slot else "is still turning"
                raise self._refuse(command, f"it {state} after {self._given:.0f} s", _RESTART)
            self._pause(_POLL)

    def _who(self, command: str) -> None:
        """Its name and firmware, as it says twice."""
        told = {self._ask(command, _WHO) for _ in range(2)}
        if len(told) > 1:
            raise self._nonsense(command, told.pop())
        data = told.pop()
        self._firmware = ".".join(str(part) for part in data[4:7])
        self._name = data[8:].split(b"\0")[0].decode("ascii", errors="replace")

    def _state(self, command: str) -> _State:
        data = self._ask(command, _WHERE)
        state = _State(data[4], data[5], (data[6], data[7], data[8]), data[9])
        if state.status == _FAILED or state.error:
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
        if not all(1 <= place <= state.slots for place in state.places):
            raise self._nonsense(command, data)
        return state

    def _ask(self, command: str, question: bytes) -> bytes:
        """What it answers; the answer must say which question it is to."""
        self._send(command, question)
        left = self._late - self._clock.now()
        data = self._link.control_in(command, *_GET_REPORT, _ASKED, left)
        if len(data) != _LENGTH or data[:4] != _ANSWER + question[1:]:
            raise self._nonsense(command, data)
        return data

    def _send(self, command: str, question: bytes) -> None:
        report = (_REQUEST + question).ljust(_LENGTH, b"\0")
        left = self._late - self._clock.now()
        self._link.control_out(command, *_SET_REPORT, report, left)

    def _nonsense(self, command: str, data: bytes) -> DeviceError:
        said = data.hex(" ") or "nothing"
        return self._refuse(command, f"it answers {said}, which makes no sense", _RESTART)


_RESTART = "If that stays, pull its plug and put it in again"
