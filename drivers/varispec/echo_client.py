"""A conversation with a VariSpec: every character is echoed, every set is asked about."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TypeVar

from drivers.errors import DeviceError
from drivers.serial_line import SerialLine
from drivers.varispec.protocol import (
    BUSY,
    ESCAPE,
    STATUS,
    Status,
    explain_error,
    integer_reply_pattern,
    parse_status,
)

T = TypeVar("T")

REPLY_TIMEOUT = 0.8
"""Seconds for one answer; electronics with RS-232 take 0.3 s for a new wavelength."""

_IMMEDIATE_TIMEOUT = 0.3
"""Seconds for the answer to a character that is answered at once."""

_ABORT_TIME = 0.02
"""Seconds, at most, from an escape character until the filter is idle."""

_QUIET = 0.07
"""Seconds without a byte after which nothing more is on its way."""

_ATTEMPTS = 3
_MIN_RETRY_TIME = 0.8
"""Seconds that must be left for another attempt."""

_NOISE = "Keep the cable away from motors and supplies; check port and baud rate"


class FilterRefusal(DeviceError):
    """The filter itself says no: asking again would not help."""


class VariSpecClient:
    """Commands and answers over a line, strictly read. terminator: "\\r" or "\\n"."""

    def __init__(self, line: SerialLine, terminator: str) -> None:
        self.line = line
        self._end = terminator.encode("ascii")
        self.failures = 0
        """Answers that didn't come or weren't what they should be, since it was opened."""

    def call_with_retry(self, resynchronise: Callable[[], object], work: Callable[[], T]) -> T:
        """Do something; once or twice again where the line failed and time is left.

        resynchronise: brings the line into step where it isn't.
        """
        for _ in range(_ATTEMPTS - 1):
            try:
                return self._once(resynchronise, work)
            except FilterRefusal:
                raise
            except DeviceError:
                if self.line.is_cancelled or self.line.time_left < _MIN_RETRY_TIME:
                    raise
        return self._once(resynchronise, work)

    def _once(self, rest: Callable[[], object], work: Callable[[], T]) -> T:
        try:
            if not self.line.in_sync:
                rest()
            return work()
        except DeviceError:
            self.failures += 1
            raise

    def send(self, text: str, command: str) -> None:
        """Send a command; it must be echoed as it was sent."""
        sent = text.encode("ascii") + self._end
        self.line.write(sent, command)
        self._expect_echo(sent, command, REPLY_TIMEOUT)

    def ask(self, text: str, pattern: re.Pattern[str], command: str) -> re.Match[str]:
        """The answer to a query, which must be as the manual says."""
        self.send(text, command)
        return self.read_reply(pattern, command)

    def read_reply(self, pattern: re.Pattern[str], command: str) -> re.Match[str]:
        answer = self.line.read_until(self._end, command, REPLY_TIMEOUT)
        found = pattern.fullmatch(answer[: -len(self._end)].decode("latin-1").strip(" "))
        if not found:
            raise self.line.error(command, f"it answers {answer!r}", _NOISE)
        return found

    def query_integer(self, letter: str, command: str) -> int:
        return int(self.ask(f"{letter} ?", integer_reply_pattern(letter), command)[1])

    def send_and_check(self, text: str, command: str) -> None:
        """Send a command that isn't answered, and ask whether it was understood."""
        self.send(text, command)
        self.require_no_error(command)

    def require_no_error(self, command: str) -> None:
        """Refusal, in words, if an error is pending, which is then cleared."""
        code = self.query_integer("R", command)
        if not code:
            return
        if self.query_integer("R", command) != code:
            raise self.line.error(command, "two answers about its error differ", _NOISE)
        self.clear_error(command)
        words, remedy = explain_error(code)
        raise FilterRefusal(self.line.model, command, words, remedy)

    def clear_error(self, command: str) -> None:
        self.send("R 1", command)

    def sleep(self, serial: str) -> None:
        """Send the filter to sleep, which it does if it doesn't answer any more."""
        self.send(f"S {int(serial)}", "sleep")
        clock = self.line.clock
        clock.wait_until(clock.now() + _ABORT_TIME, lambda: self.line.is_cancelled)
        self.line.write(STATUS, "sleep")
        self._expect_echo(STATUS, "sleep", _IMMEDIATE_TIMEOUT)
        if self.line.drain(_QUIET, 0.5, "sleep"):
            raise self.line.error("sleep", "it still answers")

    def is_busy(self, command: str) -> bool:
        """Whether commands are still being carried out; idle only if it says so twice."""
        return any(self._query_immediate(BUSY, b"<>", command) == b"<" for _ in range(2))

    def read_status(self, command: str) -> Status:
        def ask() -> Status | None:
            return parse_status(self._query_immediate(STATUS, b"", command)[0])

        status = self.confirmed_reply(ask, command)
        if status is None:
            raise self.line.error(command, "its status is none", _NOISE)
        return status

    def confirmed_reply(
        self,
        ask: Callable[[], T],
        command: str,
        matches: Callable[[T, T], bool] = lambda one, other: one == other,
    ) -> T:
        """An answer that was given three times on end: noise makes a wrong one, but not thrice."""
        told = [ask()]
        for _ in range(6):
            told.append(ask())
            if len(told) >= 3 and matches(told[-1], told[-2]) and matches(told[-1], told[-3]):
                return told[-1]
        shown = ", ".join(map(str, told))
        raise self.line.error(command, f"its answers differ: {shown}", _NOISE)

    def abort(self, command: str) -> None:
        """Abort what goes on, and forget all that is still on its way."""
        self.line.write(ESCAPE, command)
        clock = self.line.clock
        clock.wait_until(clock.now() + _ABORT_TIME, lambda: False)
        self.line.drain(_QUIET, 0.5, command)

    def _query_immediate(self, character: bytes, allowed: bytes, command: str) -> bytes:
        self.line.write(character, command)
        self._expect_echo(character, command, _IMMEDIATE_TIMEOUT)
        answer = self.line.read(1, command, _IMMEDIATE_TIMEOUT)
        if allowed and answer not in allowed:
            raise self.line.error(command, f"it answers {answer!r} to {character!r}", _NOISE)
        return answer

    def _expect_echo(self, sent: bytes, command: str, seconds: float) -> None:
        echo = self.line.read(len(sent), command, seconds)
        if echo != sent:
            raise self.line.error(command, f"{sent!r} is echoed as {echo!r}", _NOISE)
