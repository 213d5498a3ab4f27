"""Exchange commands with a filter that echoes every character; ask for errors after each."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
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


@dataclass(frozen=True)
class EchoTiming:
    """Tune the timeouts of the conversation, in seconds.

    reply_timeout: for one answer. Electronics with RS-232 take 0.3 s for a new wavelength.
    immediate_timeout: for the answer to a character that the filter answers at once. Chosen.
    abort_time: longest time from an escape character until the filter is idle.
    quiet: time without a byte after which the line counts as empty. Chosen.
    attempts: attempts at a command, the first included. Chosen.
    min_retry_time: time that must be left for another attempt. Chosen.
    """

    reply_timeout: float = 0.8
    immediate_timeout: float = 0.3
    abort_time: float = 0.02
    quiet: float = 0.07
    attempts: int = 3
    min_retry_time: float = 0.8


_TIMING = EchoTiming()

_NOISE = "Keep the cable away from motors and supplies; check port and baud rate"


class FilterRefusal(DeviceError):
    """Raised if the filter itself refuses a command, so that a retry is useless."""


class VariSpecClient:
    """Exchange commands with the filter and check every answer. terminator: "\\r" or "\\n"."""

    def __init__(self, line: SerialLine, terminator: str) -> None:
        self.line = line
        self._end = terminator.encode("ascii")
        self.failures = 0
        """Number of missing or wrong answers since the filter was opened."""

    def call_with_retry(self, resynchronise: Callable[[], object], work: Callable[[], T]) -> T:
        """Return the result of `work`; retry if the line failed and time is left.

        resynchronise: called before an attempt if commands and answers are out of step.
        """
        for _ in range(_TIMING.attempts - 1):
            try:
                return self._once(resynchronise, work)
            except FilterRefusal:
                raise
            except DeviceError:
                if self.line.is_cancelled or self.line.time_left < _TIMING.min_retry_time:
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
        """Send a command and check its echo."""
        sent = text.encode("ascii") + self._end
        self.line.write(sent, command)
        self._expect_echo(sent, command, _TIMING.reply_timeout)

    def ask(self, text: str, pattern: re.Pattern[str], command: str) -> re.Match[str]:
        """Send a query; return the answer, which must match `pattern`."""
        self.send(text, command)
        return self.read_reply(pattern, command)

    def read_reply(self, pattern: re.Pattern[str], command: str) -> re.Match[str]:
        answer = self.line.read_until(self._end, command, _TIMING.reply_timeout)
        found = pattern.fullmatch(answer[: -len(self._end)].decode("latin-1").strip(" "))
        if not found:
            raise self.line.error(command, f"it answers {answer!r}", _NOISE)
        return found

    def query_integer(self, letter: str, command: str) -> int:
        return int(self.ask(f"{letter} ?", integer_reply_pattern(letter), command)[1])

    def send_and_check(self, text: str, command: str) -> None:
        """Send a command that isn't answered, and ask whether it caused an error."""
        self.send(text, command)
        self.require_no_error(command)

    def require_no_error(self, command: str) -> None:
        """Raise FilterRefusal if an error is pending, and clear that error."""
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
        """Send the filter to sleep, and check that it no longer answers."""
        self.send(f"S {int(serial)}", "sleep")
        clock = self.line.clock
        clock.wait_until(clock.now() + _TIMING.abort_time, lambda: self.line.is_cancelled)
        self.line.write(STATUS, "sleep")
        self._expect_echo(STATUS, "sleep", _TIMING.immediate_timeout)
        if self.line.drain(_TIMING.quiet, 0.5, "sleep"):
            raise self.line.error("sleep", "it still answers")

    def is_busy(self, command: str) -> bool:
        """Return whether the filter is busy; it counts as idle only if it says so twice."""
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
        """Return an answer that came three times in a row, which rules out noise."""
        told = [ask()]
        for _ in range(6):
            told.append(ask())
            if len(told) >= 3 and matches(told[-1], told[-2]) and matches(told[-1], told[-3]):
                return told[-1]
        shown = ", ".join(map(str, told))
        raise self.line.error(command, f"its answers differ: {shown}", _NOISE)

    def abort(self, command: str) -> None:
        """Abort the running command, and discard answers that are in transit."""
        self.line.write(ESCAPE, command)
        clock = self.line.clock
        clock.wait_until(clock.now() + _TIMING.abort_time, lambda: False)
        self.line.drain(_TIMING.quiet, 0.5, command)

    def _query_immediate(self, character: bytes, allowed: bytes, command: str) -> bytes:
        self.line.write(character, command)
        self._expect_echo(character, command, _TIMING.immediate_timeout)
        answer = self.line.read(1, command, _TIMING.immediate_timeout)
        if allowed and answer not in allowed:
            raise self.line.error(command, f"it answers {answer!r} to {character!r}", _NOISE)
        return answer

    def _expect_echo(self, sent: bytes, command: str, seconds: float) -> None:
        """Read the echo of what was sent; DeviceError if it differs."""
        echo = self.line.read(len(sent), command, seconds)
        if echo != sent:
            raise self.line.error(command, f"{sent!r} is echoed as {echo!r}", _NOISE)
