"""Filter wheels of Starlight Xpress, by USB.

Source: "Handbook for the SX Universal Filter Wheel" (2009) and that of the Midi Filter Wheel
(2019), Communication Protocols: output and input reports of two bytes. What real wheels do
besides is known from public drivers (catkit, Micro-Manager, OpenAstro).
"""

from __future__ import annotations

from collections.abc import Sequence

from drivers.interfaces import Surroundings
from drivers.usb_wheel import UsbWheel

VENDOR, PRODUCT = 0x1278, 0x0920

_SET_REPORT = (0x21, 9, 0x0200)
_REPORTS_IN = 0x81
_QUERY_POSITION, _START_COUNTING = (0, 0), (0, 1)

_POLL = 0.05
_QUIET = 0.02
"""Seconds in which a report that lies ready is fetched: the host asks every 10 ms."""
_MATCHING_REPLIES = 3
"""Answers that must agree: two bytes carry no checksum."""


class StarlightWheel(UsbWheel):
    """A Starlight Xpress filter wheel: 1278:0920.

    slots_nm, names, avoid, settling_ms: see drivers.wheel.Wheel. step_ms: the most that it needs
    from a slot to the next; it takes the shorter way. serial: of the wheel, where several are
    plugged in. count_filters: have it count its filters at every start, for which it turns
    around twice; else it does so only if it doesn't know. backend: see drivers.usb_link.backend.
    """

    model = "Starlight Xpress filter wheel"
    usb_ids = (VENDOR, PRODUCT)
    _query_time = 4.0

    def __init__(
        self,
        surroundings: Surroundings,
        slots_nm: Sequence[Sequence[float]],
        names: Sequence[str] = (),
        avoid: Sequence[int] = (),
        step_ms: float = 2000.0,
        settling_ms: float = 0.0,
        serial: str = "",
        count_filters: bool = False,
        backend: str = "",
    ) -> None:
        options = (slots_nm, names, avoid, step_ms, settling_ms, serial, backend)
        super().__init__(surroundings, *options)
        if not isinstance(count_filters, bool):
            raise ValueError(f"count_filters is {count_filters!r}; it is true or false")
        self._count_filters = count_filters
        self._pending_replies = 0

    @property
    def reply_time(self) -> float:
        """Seconds for the longest way, and for counting: a wheel that got power does that first."""
        return self._turning_time + 2 * len(self._slots) * self._step

    def health(self) -> dict[str, str]:
        """What the wheel tells about itself."""
        self._start_deadline()
        position, total = self._read_confirmed_state("read its state")
        return {
            **self._descriptors(),
            "slots": str(total) if total else "not counted yet",
            "slot": str(position) if position else "turning",
        }

    def _open(self) -> None:
        command = "open"
        self._start_deadline()
        self._link.open(command)
        if self._count_filters:
            self._ask(command, _START_COUNTING)
        # It turns to its first slot when it gets power, and when it has counted.
        self._wait_at_slot(command, 0)

    def _turn_to(self, command: str, number: int) -> None:
        self._ask(command, (number, 0))
        self._wait_at_slot(command, number)

    def _read_confirmed_state(self, command: str) -> tuple[int, int]:
        """Position and number of slots, as it says several times."""
        seen = [self._ask(command, _QUERY_POSITION)]
        while len(seen) < _MATCHING_REPLIES:
            now = self._ask(command, _QUERY_POSITION)
            seen = [*seen, now] if now == seen[-1] else [now]
            if self._clock.now() >= self._deadline:
                raise self._refuse(command, "its answers differ from one to the next", "Ask again")
        return seen[-1]

    def _wait_at_slot(self, command: str, target: int) -> int:
        """The slot, once it stands there (0: anywhere), as it says several times."""
        seen: list[int] = []
        began, counting = self._deadline - self._time_granted, False
        while True:
            position, total = self._ask(command, _QUERY_POSITION)
            if position and not total and not counting:
                # It doesn't know how many it has, and doesn't find out by itself.
                position, total = self._ask(command, _START_COUNTING)
            self._require_slot_count(command, position, total)
            if counting != (total == 0):
                counting = total == 0
                since = began if counting else self._clock.now()
                self._time_granted = self.reply_time if counting else self._turning_time
                self._deadline = min(since + self._time_granted, began + self.reply_time)
            seen = [*seen, position] if position in seen[-1:] else [position]
            if position and position == (target or position) and len(seen) >= _MATCHING_REPLIES:
                return position
            if self._clock.now() >= self._deadline:
                raise self._stuck_error(command, position)
            self._pause(_QUIET if position else _POLL)

    def _require_slot_count(self, command: str, position: int, total: int) -> None:
        """DeviceError unless the wheel has as many filters as were named; 0 while it counts."""
        count = len(self._slots)
        if total == count or (total == 0 and position == 0):
            return
        self._link.may_have_late_replies = True
        raise self._refuse(
            command,
            f"the wheel has {total} slots, slots_nm names {count}",
            "Correct slots_nm; if it is right, set count_filters",
        )

    def _stuck_error(self, command: str, position: int) -> Exception:
        state = f"stands at slot {position}" if position else "is still turning"
        return self._refuse(
            command,
            f"it {state} after {self._time_granted:.0f} s",
            "See that the wheel turns freely, and pull its plug and put it in again",
        )

    def _ask(self, command: str, report: tuple[int, int]) -> tuple[int, int]:
        """A report, and the one that answers it: position (0: turning) and number of slots."""
        link = self._link
        self._discard_late_replies(command)
        left = self._deadline - self._clock.now()
        link.control_out(command, *_SET_REPORT, bytes(report), left)
        self._pending_replies += 1
        answer = link.read(command, _REPORTS_IN, 2, left)
        self._pending_replies = 0
        if len(answer) != 2 or answer[0] > (answer[1] or len(self._slots)):
            link.may_have_late_replies = True
            raise self._refuse(
                command,
                f"it answers {answer.hex(' ') or 'nothing'}, which is no state of this wheel",
                "Check slots_nm and the cable",
            )
        return answer[0], answer[1]

    def _discard_late_replies(self, command: str) -> None:
        """Let no answer to an earlier question be taken for the next one's."""
        link = self._link
        link.open(command)
        # What it owes after a failure may be late, or lost.
        quiet = link.timeout if link.may_have_late_replies and self._pending_replies else _QUIET
        came = link.drain(
            command, _REPORTS_IN, 2, quiet, lambda: self._clock.now() >= self._deadline
        )
        self._pending_replies = (
            max(self._pending_replies - came, 0) if link.may_have_late_replies else 0
        )
        link.may_have_late_replies = False
