"""A conversation with a VariSpec: every character is echoed, every set is asked about."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TypeVar

from drivers.errors import DeviceError
from drivers.serial_line import SerialLine
from drivers.varispec.protocol import BUSY, ESCAPE, STATUS, Status, explain, read_status, whole

T = TypeVar("T")

ANSWER = 0.8
"""Seconds for one answer; electronics with RS-232 take 0.3 s for a new wavelength."""

_IMMEDIATE = 0.3
"""Seconds for the answer to a character that is answered at once."""

_ABORTING = 0.02
"""Seconds, at most, from an escape character until the filter is idle."""

_QUIET = 0.07
"""Seconds without a byte after which nothing more is on its way."""

_ATTEMPTS = 3
_WORTH_WHILE = 0.8
"""Seconds that must be left for another attempt."""

_NOISE = "Keep the cable away from motors and supplies; check port and baud rate"


class Refusal(DeviceError):
    """The filter itself says no: asking again would not help."""


class Talk:
    """Commands and answers over a line, strictly read. end: "\\r" or "\\n"."""

    def __init__(self, line: SerialLine, end: str) -> None:
        self.line = line
        self._end = end.encode("ascii")
        self.failures = 0
        """Answers that didn't come or weren't what they should be, since it was opened."""

    def persist(self, rest: Callable[[], object], work: Callable[[], T]) -> T:
        """Do something; once or twice again where the line failed and time is left.

        rest: brings the line into step where it isn't.
        """
        for _ in range(_ATTEMPTS - 1):
            try:
                return self._once(rest, work)
            except Refusal:
                raise
            except DeviceError:
                if self.line.cancelled or self.line.time_left < _WORTH_WHILE:
                    raise
        return self._once(rest, work)

    def _once(self, rest: Callable[[], object], work: Callable[[], T]) -> T:
        try:
            if not self.line.in_step:
                rest()
            return work()
        except DeviceError:
            self.failures += 1
            raise

    def say(self, text: str, command: str) -> None:
        """Send a command; it must be echoed as it was sent."""
        sent = text.encode("ascii") + self._end
        self.line.write(sent, command)
        self._expect_echo(sent, command, ANSWER)

    def ask(self, text: str, pattern: re.Pattern[str], command: str) -> re.Match[str]:
        """The answer to a query, which must be as the manual says."""
        self.say(text, command)
        return self.read_answer(pattern, command)

    def read_answer(self, pattern: re.Pattern[str], command: str) -> re.Match[str]:
        answer = self.line.read_until(self._end, command, ANSWER)
        found = pattern.fullmatch(answer[: -len(self._end)].decode("latin-1").strip(" "))
        if not found:
            raise self.line.error(command, f"it answers {answer!r}", _NOISE)
        return found

    def ask_whole(self, letter: str, command: str) -> int:
        return int(self.ask(f"{letter} ?", whole(letter), command)[1])

    def set(self, text: str, command: str) -> None:
        """Send a command that isn't answered, and ask whether it was understood."""
        self.say(text, command)
        self.require_no_error(command)

    def require_no_error(self, command: str) -> None:
        """Refusal, in words, if an error is pending, which is then cleared."""
        code = self.ask_whole("R", command)
        if not code:
            return
        if self.ask_whole("R", command) != code:
            raise self.line.error(command, "two answers about its error differ", _NOISE)
        self.clear_error(command)
        words, remedy = explain(code)
        raise Refusal(self.line.model, command, words, remedy)

    def clear_error(self, command: str) -> None:
        self.say("R 1", command)

    def sleep(self, serial: str) -> None:
        """Send the filter to sleep, which it does if it doesn't answer any more."""
        self.say(f"S {int(serial)}", "sleep")
        clock = self.line.clock
        clock.wait_until(clock.now() + _ABORTING, lambda: self.line.cancelled)
        self.line.write(STATUS, "sleep")
        self._expect_echo(STATUS, "sleep", _IMMEDIATE)
        if self.line.settle(_QUIET, 0.5, "sleep"):
            raise self.line.error("sleep", "it still answers")

    def is_busy(self, command: str) -> bool:
        """Whether commands are still being carried out; idle only if it says so twice."""
        return any(self._ask_at_once(BUSY, b"<>", command) == b"<" for _ in range(2))

    def status(self, command: str) -> Status:
        def ask() -> Status | None:
            return read_status(self._ask_at_once(STATUS, b"", command)[0])

        status = self.agreed(ask, command)
        if status is None:
            raise self.line.error(command, "its status is none", _NOISE)
        return status

    def agreed(
        self,
        ask: Callable[[], T],
        command: str,
        alike: Callable[[T, T], bool] = lambda one, other: one == other,
    ) -> T:
        """An answer that was given three times on end: noise makes a wrong one, but not thrice."""
        told = [ask()]
        for _ in range(6):
            told.append(ask())
            if len(told) >= 3 and alike(told[-1], told[-2]) and alike(told[-1], told[-3]):
                return told[-1]
        shown = ", ".join(map(str, told))
        raise self.line.error(command, f"its answers differ: {shown}", _NOISE)

    def stop(self, command: str) -> None:
        """Abort what goes on, and forget all that is still on its way."""
        self.line.write(ESCAPE, command)
        clock = self.line.clock
        clock.wait_until(clock.now() + _ABORTING, lambda: False)
        self.line.settle(_QUIET, 0.5, command)

    def _ask_at_once(self, character: bytes, allowed: bytes, command: str) -> bytes:
        self.line.write(character, command)
        self._expect_echo(character, command, _IMMEDIATE)
        answer = self.line.read(1, command, _IMMEDIATE)
        if allowed and answer not in allowed:
            raise self.line.error(command, f"it answers {answer!r} to {character!r}", _NOISE)
        return answer

    def _expect_echo(self, sent: bytes, command: str, seconds: float) -> None:
        echo = self.line.read(len(sent), command, seconds)
        if echo != sent:
            raise self.line.error(command, f"{sent!r} is echoed as {echo!r}", _NOISE)
