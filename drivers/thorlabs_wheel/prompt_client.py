"""Exchange commands and answers with a device that behaves like a terminal.

The wheel echoes each command, answers a query with a value, and then sends a prompt. After a
move, the prompt comes when the move is done. Source: Thorlabs' manual of the FW102C/FW212C,
chapter 5.2.3.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TypeVar

from drivers.errors import DeviceError
from drivers.serial_line import SerialLine

T = TypeVar("T")

_PROMPT = b"> "

REPLY_TIMEOUT = 1.0
"""Seconds for an answer to a command that doesn't turn the wheel; chosen."""

_QUIET = 0.05
"""Seconds without a byte after which the line counts as empty; chosen."""

_BODY = re.compile(rb"\0*(?:([ -~]+)[\r\n]+)?")
"""What the wheel sends between echo and prompt."""

_IDENTITY = re.compile(r"THORLABS FW102C/FW212C Filter Wheel version ([0-9]+\.[0-9]+)")

_ERRORS = {
    "CMD_NOT_DEFINED": "it doesn't know the command (CMD_NOT_DEFINED)",
    "CMD_ARG_INVALID": "it refuses the value (CMD_ARG_INVALID)",
}


class UnknownCommand(DeviceError):
    """Raised for a command that the device doesn't know."""


class ThorlabsClient:
    """Exchange commands and answers, and keep each answer with its command.

    turning_time: longest time of a move in seconds. check: verifies the wheel's identity and
    settings.
    """

    def __init__(self, line: SerialLine, turning_time: float, check: Callable[[str], None]) -> None:
        self._line, self._turning, self._check = line, turning_time, check
        self._needs_lead_line = False

    def call_with_retry(self, command: str, work: Callable[[], T]) -> T:
        """Return the result of `work`; retry once after finding the prompt."""
        self.get_ready(command)
        try:
            return work()
        except DeviceError:
            if self._line.is_cancelled or not self._line.is_open:
                raise
        self.get_ready(command)
        return work()

    def get_ready(self, command: str) -> None:
        """Bring the device to its prompt, and check its identity and settings.

        This does nothing if the wheel is at its prompt already. A wheel that is still turning sends
        its prompt only when it has stopped.
        """
        if self._line.in_sync and not self._line.drain(0.0, _QUIET, command):
            return
        late = self._line.clock.now() + min(self._turning, self._line.time_left)
        prompts = 0
        while True:
            try:
                self._line.drain(_QUIET, REPLY_TIMEOUT, command)
                self._line.write(b"\r", command)
                self._line.read_until(_PROMPT, command, REPLY_TIMEOUT)
                prompts += 1
                self._line.drain(_QUIET, REPLY_TIMEOUT, command)
                self._check(command)
            except DeviceError:
                # After a prompt the wheel doesn't turn, so waiting for more than five is useless.
                over = prompts >= 5 or self._line.clock.now() >= late
                if self._line.is_cancelled or not self._line.is_open or over:
                    raise
            else:
                self._line.in_sync = True
                return

    def read_firmware(self, command: str) -> str:
        """Return the firmware version.

        This also finds out whether each command needs a line before it.
        """
        try:
            answer = self.confirmed_reply("*idn?", command)
        except UnknownCommand:
            self._needs_lead_line = not self._needs_lead_line
            try:
                answer = self.confirmed_reply("*idn?", command)
            except DeviceError:
                self._needs_lead_line = not self._needs_lead_line
                raise
        found = _IDENTITY.fullmatch(answer)
        if found is None:
            raise self._line.error(
                command, f"{answer!r} is no Thorlabs wheel", "Choose its port by: labapp devices"
            )
        return found[1]

    def query_integer(self, question: str, command: str, most: int, least: int = 1) -> int:
        """Return the answer as a whole number from `least` to `most`."""
        answer = self.confirmed_reply(question, command)
        if not re.fullmatch("[0-9]{1,2}", answer) or not least <= int(answer) <= most:
            raise self._line.error(command, f"{question} gives {answer!r}, not {least} to {most}")
        return int(answer)

    def confirmed_reply(self, question: str, command: str) -> str:
        """Return an answer that came three times in a row.

        Repetition rules out noise and late answers.
        """
        answer, times = self.ask(question, command), 1
        for _ in range(4):
            before, answer = answer, self.ask(question, command)
            times = times + 1 if answer == before else 1
            if times == 3:
                return answer
        raise self._line.error(command, f"{question} gives {answer!r} and others in turn")

    def ask(self, text: str, command: str, seconds: float = REPLY_TIMEOUT) -> str:
        """Send a command; return what comes between echo and prompt."""
        if self._needs_lead_line:
            self._exchange(b">", command, REPLY_TIMEOUT)
        answer = self._exchange(text.encode(), command, seconds)
        found = re.fullmatch("Command error (.*)", answer)
        if found is None:
            return answer
        reply = _ERRORS.get(found[1].strip(), answer)
        kind = UnknownCommand if found[1].strip() == "CMD_NOT_DEFINED" else DeviceError
        self._line.in_sync = False
        remedy = "Try again; switch the wheel off and on"
        raise kind(self._line.model, command, f"{text}: {reply}", remedy)

    def _exchange(self, sent: bytes, command: str, seconds: float) -> str:
        self._line.write(sent + b"\r", command)
        came = self._line.read_until(_PROMPT, command, seconds)
        if not came.startswith(sent + b"\r"):
            raise self._line.error(command, f"{sent!r} was echoed as {came[:60]!r}")
        found = _BODY.fullmatch(came[len(sent) + 1 : -len(_PROMPT)])
        if found is None:
            raise self._line.error(command, f"{sent!r} was answered by {came[:60]!r}")
        return (found[1] or b"").decode()
