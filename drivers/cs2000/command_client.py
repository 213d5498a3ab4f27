"""Send commands, read the answers, and explain error codes.

Source: Konica Minolta, "Spectroradiometer CS-2000/CS-2000A Communication Specifications",
rev. 7.00, 2020. The instrument echoes nothing, so important answers are asked for repeatedly,
and settings are read back.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from drivers.errors import DeviceError
from drivers.serial_line import SerialLine

T = TypeVar("T")

_END = b"\r"

LONGEST_REPLY_BITS = 9200
"""Bits of the longest answer, a block of 101 values."""

_TRANSIENT_CODES = ("00", "02", "17", "20")
"""Error codes that a late or lost message may cause, so that the command is tried again."""


@dataclass(frozen=True)
class CommandTiming:
    """Tune the timeouts of the conversation, in seconds.

    reply_timeout: for an answer. The manufacturer requires at least this much.
    short_timeout: for an answer from an instrument that may not be listening. Chosen.
    busy_timeout: for which it may take no command; its pre-measurement lasts up to 10 s.
    reply_latency: approximate time until it begins an answer.
    quiet: time without a byte after which an answer counts as complete. Chosen.
    quiet_periods: the same when the state of the line is unknown: one period per attempt. Chosen.
    max_rounds: attempts to synchronise with an instrument that answers. Chosen.
    """

    reply_timeout: float = 10.0
    short_timeout: float = 2.0
    busy_timeout: float = 12.0
    reply_latency: float = 0.05
    quiet: float = 0.02
    quiet_periods: tuple[float, ...] = (0.1, 1.0, 4.0)
    max_rounds: int = 3


_TIMING = CommandTiming()

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
    """Raised for an error code from the instrument. code: its two digits."""

    code = ""


class MeasurementCancelled(DeviceError):
    """Raised if the caller cancelled a measurement."""


class CS2000Client:
    """Exchange commands and answers, and keep each answer with its command.

    baudrate: of the serial line. check: verifies the instrument's identity and settings.
    """

    def __init__(self, line: SerialLine, baudrate: int, check: Callable[[str], None]) -> None:
        self.line, self._check = line, check
        self._longest = LONGEST_REPLY_BITS / baudrate
        self.reply_timeout = _TIMING.reply_timeout + self._longest
        """Seconds for an answer, including its transmission over the line."""

    def ask(
        self, text: str, command: str, seconds: float | None = None, is_long: bool = False
    ) -> str:
        """Send a command; return its answer without the code and the comma.

        is_long: whether the longest answer is expected, so that its transmission is waited for.
        """
        self.send(text, command)
        if is_long:
            self.line.clock.wait_until(
                self.line.clock.now() + self._longest + _TIMING.reply_latency,
                lambda: self.line.is_cancelled,
            )
        return self.read_reply(text, command, seconds)

    def send(self, text: str, command: str) -> None:
        """Send a command without reading the answer."""
        if self.line.drain(_TIMING.quiet, _TIMING.short_timeout, command):
            raise self.line.error(command, f"before {text} came what nobody asked for", _CABLE)
        self.line.write(text.encode() + _END, command)

    def read_reply(self, text: str, command: str, seconds: float | None = None) -> str:
        """Read the next answer; CodeError if it is an error. text: the command."""
        patience = self.reply_timeout if seconds is None else seconds
        came = self.line.read_until(_END, command, patience)
        found = _REPLY.fullmatch(came[:-1].decode("latin-1"))
        if found is None:
            raise self.line.error(command, f"{text} gives {came[:60]!r}", _CABLE)
        if found[1] == "ER":
            raise self._code_error(text, command, found[2])
        return found[3][1:]

    def confirmed_reply(self, text: str, pattern: str, command: str) -> re.Match[str]:
        """Return an answer that came three times in a row.

        Repetition rules out noise and late answers.
        """
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
        """Change a setting only if it differs, and read it back with `query`.

        The instrument's memory wears out with each write.
        """
        if self._is_set(query, value, command):
            return
        self.ask(f"{name},{value}", command)
        if not self._is_set(query, value, command):
            raise self.line.error(command, f"{name} doesn't become {value}", "Try again")

    def _is_set(self, question: str, wanted: str, command: str) -> bool:
        told = self.confirmed_reply(question, "[0-9,]+", command)[0]
        return [int(part) for part in told.split(",")] == [int(p) for p in wanted.split(",")]

    def call_with_retry(self, command: str, work: Callable[[], T]) -> T:
        """Return the result of `work`; retry once after a late or lost message."""
        late = self.line.clock.now() + _TIMING.reply_timeout
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
        self.get_ready(command, _TIMING.quiet_periods[-1:])
        return work()

    def get_ready(self, command: str, rests: tuple[float, ...] = _TIMING.quiet_periods) -> None:
        """Synchronise with the instrument and check it, unless the line is in sync already.

        rests: seconds of quiet to wait for, one value per attempt.
        """
        late = self.line.clock.now() + min(_TIMING.busy_timeout, self.line.time_left)
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
                # An instrument that doesn't answer is asked until the busy time is over.
                spoke = isinstance(error, CodeError)
                over = (spoke and rounds >= _TIMING.max_rounds) or self.line.clock.now() >= late
                lost = self.line.is_cancelled or not self.line.is_open
                if over or lost or not passing:
                    raise

    def _resynchronise(self, command: str, quiet: float) -> None:
        """Discard late answers, stop a running measurement, and set the remote mode.

        The instrument also discards a command that it has received only in part.
        """
        self.line.drain(quiet, quiet + _TIMING.short_timeout, command)
        self.line.write(_END, command)
        self.line.drain(_TIMING.quiet_periods[0], _TIMING.short_timeout, command)
        # ER17 means that it wasn't measuring; ER00 that it isn't in remote mode.
        self._obeys("MEAS,0", command, ("17", "00"))
        if not self._obeys("RMTS,2", command, ("17", "00")):
            # Firmware before 3.00.9301 knows only the mode that writes settings into its flash.
            self.ask("RMTS,1", command, _TIMING.short_timeout)

    def _obeys(self, text: str, command: str, harmless: tuple[str, ...]) -> bool:
        """Return whether a command is accepted; CodeError except for harmless codes."""
        try:
            self.ask(text, command, _TIMING.short_timeout)
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
