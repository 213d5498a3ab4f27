"""Driver of Starlight Xpress filter wheels.

Source: "Handbook for the SX Universal Filter Wheel" (2009) and that of the Midi Filter Wheel
(2019), Communication Protocols: output and input reports of two bytes. Further behaviour of real
wheels is known from public drivers (catkit, Micro-Manager, OpenAstro).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from drivers.interfaces import Surroundings
from drivers.usb_wheel import UsbWheel

_SET_REPORT = (0x21, 9, 0x0200)
"""Request type, request and value of the control transfer that sends an output report."""

_REPORTS_IN = 0x81
"""Endpoint of the input reports."""

_QUERY_POSITION, _START_COUNTING = (0, 0), (0, 1)


@dataclass(frozen=True)
class StarlightPolling:
    """Tune how often the wheel is asked, and how many replies are believed.

    interval: seconds between queries while the wheel turns (chosen).
    quiet: seconds in which the host surely fetches a report that is ready: it asks every 10 ms.
    matching_replies: equal replies in a row that are believed (chosen). One isn't enough, because
    two bytes carry no checksum.
    """

    interval: float = 0.05
    quiet: float = 0.02
    matching_replies: int = 3


_POLLING = StarlightPolling()


class StarlightWheel(UsbWheel):
    """Turn a Starlight Xpress filter wheel, 1278:0920 on USB.

    slots_nm, names, avoid, settling_ms: see drivers.wheel.Wheel. step_ms: longest time from a slot
    to the next; the wheel takes the shorter way. serial: serial number of the wheel, if several
    are plugged in. count_filters: whether the wheel counts its filters at every start, for which it
    turns around twice; otherwise it counts them only if it doesn't know their number. backend: see
    drivers.usb_link.backend.
    """

    model = "Starlight Xpress filter wheel"
    usb_ids = (0x1278, 0x0920)
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
        """Seconds for the longest turn, and for counting the slots, as on power-up."""
        return self._turning_time + 2 * len(self._slots) * self._step

    def health(self) -> dict[str, str]:
        """Return what the wheel reports about itself, by name."""
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
        # The wheel turns to its first slot on power-up and after counting.
        self._wait_at_slot(command, 0)

    def _turn_to(self, command: str, number: int) -> None:
        self._ask(command, (number, 0))
        self._wait_at_slot(command, number)

    def _read_confirmed_state(self, command: str) -> tuple[int, int]:
        """Return position and slot count once the replies agree."""
        seen = [self._ask(command, _QUERY_POSITION)]
        while len(seen) < _POLLING.matching_replies:
            now = self._ask(command, _QUERY_POSITION)
            seen = [*seen, now] if now == seen[-1] else [now]
            if self._clock.now() >= self._deadline:
                raise self._refuse(command, "its answers differ from one to the next", "Ask again")
        return seen[-1]

    def _wait_at_slot(self, command: str, target: int) -> int:
        """Wait until the target slot is reported several times in a row; return the slot.

        target: 0 for any slot.
        """
        seen: list[int] = []
        began, counting = self._deadline - self._time_granted, False
        while True:
            position, total = self._ask(command, _QUERY_POSITION)
            if position and not total and not counting:
                # The wheel doesn't know its number of slots, and doesn't count them by itself.
                position, total = self._ask(command, _START_COUNTING)
            self._require_slot_count(command, position, total)
            if counting != (total == 0):
                counting = total == 0
                since = began if counting else self._clock.now()
                self._time_granted = self.reply_time if counting else self._turning_time
                self._deadline = min(since + self._time_granted, began + self.reply_time)
            seen = [*seen, position] if position in seen[-1:] else [position]
            enough = len(seen) >= _POLLING.matching_replies
            if position and position == (target or position) and enough:
                return position
            if self._clock.now() >= self._deadline:
                raise self._stuck_error(command, position)
            self._pause(_POLLING.quiet if position else _POLLING.interval)

    def _require_slot_count(self, command: str, position: int, total: int) -> None:
        """Raise DeviceError unless the wheel has as many slots as `slots_nm` names.

        While the wheel counts its slots, it reports 0 for both numbers.
        """
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
        """Send a report; return the position (0: turning) and the number of slots."""
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
        """Discard late replies to earlier queries.

        Otherwise a late reply could be mistaken for the answer to the next query.
        """
        link = self._link
        link.open(command)
        # After a failure a reply that is still missing may come late or never.
        late = link.may_have_late_replies and self._pending_replies
        quiet = link.timeout if late else _POLLING.quiet
        came = link.drain(
            command, _REPORTS_IN, 2, quiet, lambda: self._clock.now() >= self._deadline
        )
        self._pending_replies = (
            max(self._pending_replies - came, 0) if link.may_have_late_replies else 0
        )
        link.may_have_late_replies = False
