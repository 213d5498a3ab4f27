"""Run one measurement from start to end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from drivers.cs2000.command_client import CodeError, CS2000Client, MeasurementCancelled
from drivers.errors import DeviceError

COMMAND = "measure"
"""The name of the command in error messages."""


@dataclass(frozen=True)
class MeasurementTiming:
    """Tune how a measurement is waited for, in seconds.

    pre_measurement: for the pre-measurement, which takes 1 to 10 s.
    overtime: by which a measurement may last longer than the instrument announced. Chosen.
    query_interval: between queries of whether it still measures; a twentieth of the measurement's
    duration is added. Chosen.
    poll_interval: between checks of whether the measurement was cancelled. Chosen.
    busy_interval: between queries to an instrument that is still measuring at the end. Chosen.
    """

    pre_measurement: float = 12.0
    overtime: float = 5.0
    query_interval: float = 4.0
    poll_interval: float = 0.2
    busy_interval: float = 0.5


TIMING = MeasurementTiming()


class CS2000Measurement:
    """Start a measurement on an instrument that is ready, and wait for its end.

    cancelled: returns whether the caller has cancelled. note_progress: called after each step.
    """

    def __init__(
        self, link: CS2000Client, cancelled: Callable[[], bool], note_progress: Callable[[], None]
    ) -> None:
        self._link, self._line, self._clock = link, link.line, link.line.clock
        self._cancelled, self._got_on = cancelled, note_progress

    def start(self) -> int:
        """Start; return the duration in seconds that the instrument announces."""
        self._link.send("MEAS,1", COMMAND)
        late = self._clock.now() + TIMING.pre_measurement
        while not self._line.has_received(b"\r", COMMAND, TIMING.poll_interval):
            self._check_cancelled()
            if self._clock.now() >= late:
                raise self._line.error(
                    COMMAND, f"MEAS,1 isn't answered within {TIMING.pre_measurement:g} s"
                )
        told = self._link.read_reply("MEAS,1", COMMAND)
        if len(told) != 3 or not told.isdecimal() or not 2 <= int(told) <= 242:
            raise self._line.error(COMMAND, f"it takes {told!r} s, not 002 to 242", "Try again")
        # A late answer to an earlier command may look the same, so ask whether it measures.
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
        """Wait until the measurement has ended; CodeError if it failed.

        seconds: the duration that start() returned.
        """
        late = self._clock.now() + seconds + TIMING.overtime
        pause = TIMING.query_interval + seconds / 20
        ask_at = self._clock.now() + pause
        while not self._has_finished():
            if self._clock.now() >= ask_at:
                # The message of its end may have been garbled or lost on the line.
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
                    f"it doesn't come to an end: {seconds} s were told, "
                    f"{TIMING.overtime:g} more granted",
                    "Switch it off and on",
                )
        while self._may_be_measuring() and self._clock.now() < late:
            self._check_cancelled()
            self._clock.wait_until(self._clock.now() + TIMING.busy_interval, self._cancelled)

    def _has_finished(self) -> bool:
        """Return whether the end is reported; CodeError if a failure is."""
        if not self._line.has_received(b"\r", COMMAND, TIMING.poll_interval):
            return False
        return self._ask_tolerantly(lambda: self._link.read_reply("MEAS,1", COMMAND) == "", False)

    def _may_be_measuring(self) -> bool:
        return self._ask_tolerantly(self._is_measuring, True)

    def _ask_tolerantly(self, ask: Callable[[], bool], default: bool) -> bool:
        """Return the answer; `default` if it is late or garbled.

        The question can be repeated later.
        """
        try:
            return ask()
        except CodeError:
            raise
        except DeviceError:
            if self._line.is_cancelled or not self._line.is_open:
                raise
            return default

    def _check_cancelled(self) -> None:
        """Note progress; DeviceError if the caller has cancelled."""
        self._got_on()
        if self._cancelled():
            self._line.in_sync = False
            raise MeasurementCancelled(
                self._line.model, COMMAND, "it was cancelled", "Measure again"
            )
