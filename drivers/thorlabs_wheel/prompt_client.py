"""What a wheel of Thorlabs is told and tells, as to a person at a terminal.

It echoes each command, tells a value where one was asked for, and then prompts, after a move as
soon as that is done. Source: Thorlabs' manual of the FW102C/FW212C, chapter 5.2.3.
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
"""Seconds for an answer that needs no turning."""

_MAX_PROMPTS = 5
"""Times that it is brought to its prompt before it is given up."""

_QUIET = 0.05
"""Seconds without a byte, after which nothing more is expected."""

_BODY = re.compile(rb"\0*(?:([ -~]+)[\r\n]+)?")
"""Between echo and prompt."""

_IDENTITY = re.compile(r"THORLABS FW102C/FW212C Filter Wheel version ([0-9]+\.[0-9]+)")

_ERRORS = {
    "CMD_NOT_DEFINED": "it doesn't know the command (CMD_NOT_DEFINED)",
    "CMD_ARG_INVALID": "it refuses the value (CMD_ARG_INVALID)",
}


class UnknownCommand(DeviceError):
    """The wheel says that it doesn't know a command."""


class ThorlabsClient:
    """Questions to a wheel and its answers, never one for another.

    turning_time: seconds for which it may turn. check: that it is the right one, set as wanted.
    """

    def __init__(self, line: SerialLine, turning_time: float, check: Callable[[str], None]) -> None:
        self._line, self._turning, self._check = line, turning_time, check
        self._needs_lead_line = False

    def call_with_retry(self, command: str, work: Callable[[], T]) -> T:
        """The result of work, tried again where something late may have got in between."""
        self.get_ready(command)
        try:
            return work()
        except DeviceError:
            if self._line.is_cancelled or not self._line.is_open:
                raise
        self.get_ready(command)
        return work()

    def get_ready(self, command: str) -> None:
        """Bring it to its prompt, unless it is there, and check that it is as it should be.

        A wheel that still turns prompts only when it stands.
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
                # A prompt says that it doesn't turn: more of them change nothing.
                over = prompts >= _MAX_PROMPTS or self._line.clock.now() >= late
                if self._line.is_cancelled or not self._line.is_open or over:
                    raise
            else:
                self._line.in_sync = True
                return

    def read_firmware(self, command: str) -> str:
        """Its version; whether it wants a line before each command is found out, too."""
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
        """A whole number from `least` to `most`."""
        answer = self.confirmed_reply(question, command)
        if not re.fullmatch("[0-9]{1,2}", answer) or not least <= int(answer) <= most:
            raise self._line.error(command, f"{question} gives {answer!r}, not {least} to {most}")
        return int(answer)

    def confirmed_reply(self, question: str, command: str) -> str:
        """An answer given three times in a row: noise and late answers don't agree."""
        answer, times = self.ask(question, command), 1
        for _ in range(4):
            before, answer = answer, self.ask(question, command)
            times = times + 1 if answer == before else 1
            if times == 3:
                return answer
        raise self._line.error(command, f"{question} gives {answer!r} and others in turn")

    def ask(self, text: str, command: str, seconds: float = REPLY_TIMEOUT) -> str:
        """Say something; what comes back before the prompt, but for the echo."""
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
