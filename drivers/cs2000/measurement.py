"""One measurement of a CS-2000, from its beginning to its end."""

from __future__ import annotations

from collections.abc import Callable

from drivers.cs2000.command_client import CodeError, CS2000Client, MeasurementCancelled
from drivers.errors import DeviceError

COMMAND = "measure"
"""What it is called in errors."""

_PRE_MEASUREMENT_TIME = 12.0
"""Seconds for a pre-measurement, which takes one to ten."""

OVERTIME = 5.0
"""Seconds by which a measurement may last longer than it was told."""

_QUERY_INTERVAL = 4.0
"""Seconds, and a twentieth of the measurement's, between questions whether it still measures."""

_POLL_INTERVAL = 0.2
"""Seconds between looks at whether a measurement was cancelled."""

_BUSY_INTERVAL = 0.5
"""Seconds between questions to an instrument that is still measuring."""


class CS2000Measurement:
    """Has an instrument measure that is ready for it.

    cancelled: whether nobody wants it any more. note_progress: called whenever it has got on.
    """

    def __init__(
        self, link: CS2000Client, cancelled: Callable[[], bool], note_progress: Callable[[], None]
    ) -> None:
        self._link, self._line, self._clock = link, link.line, link.line.clock
        self._cancelled, self._got_on = cancelled, note_progress

    def start(self) -> int:
        """Begin to measure; how long it will take, in seconds, as it then tells."""
        self._link.send("MEAS,1", COMMAND)
        late = self._clock.now() + _PRE_MEASUREMENT_TIME
        while not self._line.has_received(b"\r", COMMAND, _POLL_INTERVAL):
            self._check_cancelled()
            if self._clock.now() >= late:
                raise self._line.error(
                    COMMAND, f"MEAS,1 isn't answered within {_PRE_MEASUREMENT_TIME:g} s"
                )
        told = self._link.read_reply("MEAS,1", COMMAND)
        if len(told) != 3 or not told.isdecimal() or not 2 <= int(told) <= 242:
            raise self._line.error(COMMAND, f"it takes {told!r} s, not 002 to 242", "Try again")
        # An old answer may look the same; what it says now proves that it does measure.
        if not self._is_measuring():
            raise self._line.error(COMMAND, "it doesn't measure", "Try again")
        return int(told)

    def _is_measuring(self) -> bool:
        try:
            self._link.ask("MEDR,0,0,1", COMMAND)
        except CodeError as error:
            if error.code not in ("02", "00"):
                raise
            self._line.in_sync = True
            return True
        return False

    def await_end(self, seconds: int) -> None:
        """Wait until it has measured. seconds: as start() told; CodeError says why it couldn't."""
        late = self._clock.now() + seconds + OVERTIME
        pause = _QUERY_INTERVAL + seconds / 20
        ask_at = self._clock.now() + pause
        while not self._has_finished():
            if self._clock.now() >= ask_at:
                # What it told may have been spoilt on its way, or its end not have come.
                if not self._may_be_measuring():
                    return
                ask_at = self._clock.now() + pause
            if self._cancelled():
                self._line.write(b"MEAS,0\r", COMMAND)
            self._check_cancelled()
            if self._clock.now() >= late:
                self._line.write(b"MEAS,0\r", COMMAND)
                raise self._line.error(
                    COMMAND,
                    f"it doesn't come to an end: {seconds} s were told, {OVERTIME:g} more granted",
                    "Switch it off and on",
                )
        while self._may_be_measuring() and self._clock.now() < late:
            self._check_cancelled()
            self._clock.wait_until(self._clock.now() + _BUSY_INTERVAL, self._cancelled)

    def _has_finished(self) -> bool:
        """Whether it says that it has measured; CodeError if it says why it couldn't."""
        if not self._line.has_received(b"\r", COMMAND, _POLL_INTERVAL):
            return False
        return self._ask_tolerantly(lambda: self._link.read_reply("MEAS,1", COMMAND) == "", False)

    def _may_be_measuring(self) -> bool:
        return self._ask_tolerantly(self._is_measuring, True)

    def _ask_tolerantly(self, ask: Callable[[], bool], default: bool) -> bool:
        """An answer; `default` where it is an old or a broken one, for it can be asked again."""
        try:
            return ask()
        except CodeError:
            raise
        except DeviceError:
            if self._line.is_cancelled or not self._line.is_open:
                raise
            return default

    def _check_cancelled(self) -> None:
        """Tell that it gets on; DeviceError if nobody wants it any more."""
        self._got_on()
        if self._cancelled():
            self._line.in_sync = False
            raise MeasurementCancelled(
                self._line.model, COMMAND, "it was cancelled", "Measure again"
            )
