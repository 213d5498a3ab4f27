"""What a CS-2000 is told and tells: commands, answers, and its errors in words.

Source: Konica Minolta, "Spectroradiometer CS-2000/CS-2000A Communication Specifications",
rev. 7.00, 2020. Nothing is echoed: what matters is asked twice, and read back when it was set.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TypeVar

from drivers.errors import DeviceError
from drivers.serial_line import SerialLine

T = TypeVar("T")

_END = b"\r"

REPLY_TIMEOUT = 10.0
"""Seconds for an answer; its maker asks that it be granted no less."""

LONGEST_REPLY_BITS = 9200
"""Bits of the longest answer, a block of 101 values."""

_TRANSIENT_CODES = ("00", "02", "17", "20")
"""Codes that something late or lost may have brought about, so that it is worth another try."""

_MAX_ROUNDS = 3
"""Times that it is brought to rest, if it answers at all, before it is given up."""

_QUIET = 0.02
"""Seconds without a byte, after which an answer counts as the only one."""

_REPLY_LATENCY = 0.05
"""Seconds that it takes to begin an answer, more or less."""

_QUIET_PERIODS = (0.1, 1.0, 4.0)
"""The same where anything may still be on its way: at first, and where that wasn't enough."""

_SHORT_TIMEOUT = 2.0
"""Seconds for an answer of an instrument that may be deaf just now."""

_BUSY_TIMEOUT = 12.0
"""Seconds for which it may take no command: its pre-measurement lasts up to ten."""

_REPLY = re.compile(r"(OK(?=00)|ER)([0-9]{2})((?:,[ -+\--~]*)*)")

_CABLE = "Check the cable and that the port is the instrument's"

_ERRORS = {
    "00": (
        "it takes no such command now: somebody may have pressed ESC on it",
        "Leave its keys alone, and try again",
    ),
    "02": ("it is still measuring", "Try again"),
    "05": (
        "it has no correction for that lens, filter or calibration channel",
        "Store the correction in the instrument, or take lens and filter off",
    ),
    "10": (
        "the light is too bright for it, or flickers too much",
        "Dim the light, turn its dial to a smaller field, or choose sync",
    ),
    "17": ("it refuses a value", "Look up what its firmware knows"),
    "20": ("it has no measurement: somebody may have pressed ESC on it", "Measure again"),
    "30": ("its memory fails", "Have it serviced"),
    "32": ("its memory fails", "Have it serviced"),
    "34": ("its memory fails", "Have it serviced"),
    "51": ("its sensor is too warm or too cold", "Let it come to 5 to 35 °C"),
    "52": ("its sensor is too warm or too cold", "Let it come to 5 to 35 °C"),
    "71": ("it finds no sync signal from 20 to 200 Hz", "Check the sync cable, or set sync"),
    "81": ("its shutter fails", "Switch it off and on; if it goes on, have it serviced"),
    "82": ("its internal filter fails", "Switch it off and on; if it goes on, have it serviced"),
    "83": (
        "the dial of its measuring angle stands between two angles, or was moved",
        "Turn the dial until it clicks, and measure again",
    ),
    "84": ("its fan fails", "Switch it off, and have it serviced"),
    "99": ("its program failed", "Switch it off and on"),
}


class CodeError(DeviceError):
    """The instrument says by a code what is wrong. code: its two digits."""

    code = ""


class MeasurementCancelled(DeviceError):
    """Nobody wants it any more."""


class CS2000Client:
    """Questions to the instrument and its answers, never one for another.

    baudrate: of the line. check: that the instrument is the right one and as it should be.
    """

    def __init__(self, line: SerialLine, baudrate: int, check: Callable[[str], None]) -> None:
        self.line, self._check = line, check
        self._longest = LONGEST_REPLY_BITS / baudrate
        self.reply_timeout = REPLY_TIMEOUT + self._longest
        """Seconds for an answer, its way over the line included."""

    def ask(
        self, text: str, command: str, seconds: float | None = None, is_long: bool = False
    ) -> str:
        """Say something; what the answer has after its code, but for the comma.

        is_long: whether it will be as long as answers are, so that nothing is missed in between.
        """
        self.send(text, command)
        if is_long:
            self.line.clock.wait_until(
                self.line.clock.now() + self._longest + _REPLY_LATENCY,
                lambda: self.line.is_cancelled,
            )
        return self.read_reply(text, command, seconds)

    def send(self, text: str, command: str) -> None:
        """Say something, and leave the answer for later."""
        if self.line.drain(_QUIET, _SHORT_TIMEOUT, command):
            raise self.line.error(command, f"before {text} came what nobody asked for", _CABLE)
        self.line.write(text.encode() + _END, command)

    def read_reply(self, text: str, command: str, seconds: float | None = None) -> str:
        """The next answer; CodeError where it is no good one. text: what it answers."""
        patience = self.reply_timeout if seconds is None else seconds
        came = self.line.read_until(_END, command, patience)
        found = _REPLY.fullmatch(came[:-1].decode("latin-1"))
        if found is None:
            raise self.line.error(command, f"{text} gives {came[:60]!r}", _CABLE)
        if found[1] == "ER":
            raise self._code_error(text, command, found[2])
        return found[3][1:]

    def confirmed_reply(self, text: str, pattern: str, command: str) -> re.Match[str]:
        """An answer given three times in a row: noise and late answers don't agree."""
        answer, times = self.ask(text, command), 1
        for _ in range(4):
            before, answer = answer, self.ask(text, command)
            times = times + 1 if answer == before else 1
            if times == 3:
                break
        else:
            raise self.line.error(command, f"{text} gives {answer!r} and others in turn", _CABLE)
        found = re.fullmatch(pattern, answer)
        if found is None:
            raise self.line.error(command, f"{text} gives {answer!r}", _CABLE)
        return found

    def set(self, name: str, value: str, query: str, command: str) -> None:
        """Set what isn't so yet, for its memory wears, and see that it is. query: by a question."""
        if self._is_set(query, value, command):
            return
        self.ask(f"{name},{value}", command)
        if not self._is_set(query, value, command):
            raise self.line.error(command, f"{name} doesn't become {value}", "Try again")

    def _is_set(self, question: str, wanted: str, command: str) -> bool:
        told = self.confirmed_reply(question, "[0-9,]+", command)[0]
        return [int(part) for part in told.split(",")] == [int(p) for p in wanted.split(",")]

    def call_with_retry(self, command: str, work: Callable[[], T]) -> T:
        """The result of work, tried again where something late may have got in between."""
        late = self.line.clock.now() + REPLY_TIMEOUT
        self.get_ready(command)
        try:
            return work()
        except CodeError as error:
            if error.code not in _TRANSIENT_CODES or self.line.clock.now() > late:
                raise
        except DeviceError as error:
            unwanted = isinstance(error, MeasurementCancelled) or self.line.is_cancelled
            if unwanted or not self.line.is_open or self.line.clock.now() > late:
                raise
        self.get_ready(command, _QUIET_PERIODS[-1:])
        return work()

    def get_ready(self, command: str, rests: tuple[float, ...] = _QUIET_PERIODS) -> None:
        """End what it does, take it over, and check it; unless nothing went wrong before.

        rests: seconds of quiet that are waited for, time after time.
        """
        late = self.line.clock.now() + min(_BUSY_TIMEOUT, self.line.time_left)
        rounds = 0
        while not self.line.in_sync:
            try:
                quiet = rests[min(rounds, len(rests) - 1)]
                rounds += 1
                self._resynchronise(command, quiet)
                self._check(command)
                self.line.in_sync = True
            except DeviceError as error:
                passing = not isinstance(error, CodeError) or error.code in _TRANSIENT_CODES
                # A deaf one is asked as long as it may be deaf.
                spoke = isinstance(error, CodeError)
                over = (spoke and rounds >= _MAX_ROUNDS) or self.line.clock.now() >= late
                lost = self.line.is_cancelled or not self.line.is_open
                if over or lost or not passing:
                    raise

    def _resynchronise(self, command: str, quiet: float) -> None:
        """No half command, no measurement, no answer on its way; and remote mode."""
        self.line.drain(quiet, quiet + _SHORT_TIMEOUT, command)
        self.line.write(_END, command)
        self.line.drain(_QUIET_PERIODS[0], _SHORT_TIMEOUT, command)
        # ER17: it wasn't measuring. ER00: it isn't in remote mode.
        self._obeys("MEAS,0", command, ("17", "00"))
        if not self._obeys("RMTS,2", command, ("17", "00")):
            # Firmware before 3.00.9301 knows only the mode that writes settings into its flash.
            self.ask("RMTS,1", command, _SHORT_TIMEOUT)

    def _obeys(self, text: str, command: str, harmless: tuple[str, ...]) -> bool:
        """Whether it obeys; CodeError but for the harmless codes."""
        try:
            self.ask(text, command, _SHORT_TIMEOUT)
        except CodeError as error:
            if error.code not in harmless:
                raise
            return False
        return True

    def _code_error(self, text: str, command: str, code: str) -> CodeError:
        reply, remedy = _ERRORS.get(
            code, ("it gives a code that its description lacks", "Try again")
        )
        self.line.in_sync = False
        error = CodeError(self.line.model, command, f"{text}: {reply} (ER{code})", remedy)
        error.code = code
        return error
