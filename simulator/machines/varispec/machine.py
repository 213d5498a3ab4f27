"""A VariSpec behind its serial port: echo, queue, immediate characters and time."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Literal

from simulator.machines.machine import FaultyMachine, Reply
from simulator.machines.varispec.commands import execute, parse_command, parse_integer, reply_lines
from simulator.machines.varispec.state import CommandError, VariSpecState

_INITIALISATION_TIME = 30.0
_EXERCISE_TIME = 12.0
"""Seconds of one exercise of the liquid crystals."""

_COMMAND_TIME = 0.0015
"""Seconds of anything else: "within a millisecond or two"."""

_CALCULATION_TIMES = {"usb": _COMMAND_TIME, "rs232": 0.3}
"""Seconds in which the electronics find the drive levels of a wavelength."""

_ABORT_TIME = 0.02
_BUFFER = 256
_ESCAPE, _BUSY, _STATUS = b"\x1b", b"!", b"@"

_LOWER = "VBPM"
"""Letters that some firmware answers in lower case."""


def _warm_up_temperature(t: float) -> float:
    """Degrees Celsius: it warms up by 4 in an hour or so."""
    return 25.0 - 4.0 * math.exp(-max(t, 0.0) / 1200.0)


class VariSpecMachine(FaultyMachine):
    """The command set of the VariSpec user manual 1.37, over USB or over RS-232.

    range_nm: shortest and longest wavelength. serial: five digits. electronics: "rs232" takes
    0.3 s for a new wavelength. powered_at: when it was switched on, in seconds of the bench's
    clock; it initialises itself for 30 s then, unless `initialises` is False. temperature: of the
    optics in degrees Celsius, by the time. on_tuned: is told each new wavelength, in metres.
    """

    own_faults: tuple[str, ...] = ("busy forever", "error code", "uninitialised")

    def __init__(
        self,
        *,
        range_nm: tuple[float, float] = (400.0, 720.0),
        serial: int = 50527,
        firmware: str = "141",
        electronics: Literal["usb", "rs232"] = "usb",
        terminator: bytes = b"\r",
        powered_at: float = -math.inf,
        initialises: bool = True,
        temperature: Callable[[float], float] = _warm_up_temperature,
        on_tuned: Callable[[float], None] = lambda wavelength: None,
    ) -> None:
        super().__init__()
        self.serial, self.firmware = serial, firmware
        self.terminator = terminator
        self._calculating = _CALCULATION_TIMES[electronics]
        self._heat = temperature
        self._initialises = initialises
        self._tell = on_tuned
        self._range = range_nm
        self.power_up(powered_at)

    def power_up(self, t: float) -> None:
        """Everything as it is when it is switched on."""
        shortest, longest = self._range
        self.state = VariSpecState(shortest, longest, lambda nm: self._tell(round(nm * 100) / 1e11))
        self._line = bytearray()
        self._queue: deque[bytes] = deque()
        self._finish: Callable[[float], list[str]] | None = None
        self._done_at = -math.inf
        if self._initialises:
            self._begin(t, _INITIALISATION_TIME, self._initialise)

    def feed(self, data: bytes, t: float) -> list[Reply]:
        replies = self._advance(t)
        for byte in data:
            replies += self._receive_byte(bytes([byte]), t)
            replies += self._advance(t)
        return replies

    def _receive_byte(self, byte: bytes, t: float) -> list[Reply]:
        echo = Reply(t, byte)
        awake = not self.state.asleep
        if byte == _ESCAPE:
            return [echo, *(self._abort(t) if awake else [])]
        if byte == _BUSY:
            return [echo, *([Reply(t, b"<" if self._is_busy else b">")] if awake else [])]
        if byte == _STATUS:
            return [echo, *([Reply(t, bytes([self._status]))] if awake else [])]
        if byte == self.terminator:
            self._queue.append(bytes(self._line))
            self._line.clear()
        elif len(self._line) + sum(map(len, self._queue)) < _BUFFER:
            self._line += byte
        return [echo]

    def _abort(self, t: float) -> list[Reply]:
        self._queue.clear()
        self._line.clear()
        if self._finish is None:
            return []
        self.state.pending = 0
        self._begin(t, _ABORT_TIME, lambda t: [])
        return [Reply(self._done_at, b"")]

    @property
    def _is_busy(self) -> bool:
        return self._finish is not None or bool(self._queue) or "busy forever" in self._faults

    @property
    def _status(self) -> int:
        return self.state.status & ~1 if "uninitialised" in self._faults else self.state.status

    def _advance(self, t: float) -> list[Reply]:
        """Finish what is due, and begin what waits."""
        replies: list[Reply] = []
        while "busy forever" not in self._faults:
            if self._finish is not None:
                if t < self._done_at:
                    break
                finish, self._finish = self._finish, None
                lines = (line.encode("ascii") for line in self._try(finish, t))
                replies += [Reply(t, line + self.terminator) for line in lines]
            elif self._queue:
                self._try(lambda t: self._start(self._queue.popleft(), t), t)
                if self._finish is not None:
                    replies.append(Reply(self._done_at, b""))
            else:
                break
        return replies

    def _try(self, work: Callable[[float], list[str]], t: float) -> list[str]:
        initialised = self.state.initialised
        if "uninitialised" in self._faults:
            self.state.initialised = False
        try:
            return work(t)
        except CommandError as fault:
            self.state.error = fault.code
            return []
        finally:
            if "uninitialised" in self._faults:
                self.state.initialised = initialised

    def _begin(self, t: float, seconds: float, finish: Callable[[float], list[str]]) -> None:
        self._finish, self._done_at = finish, t + seconds

    def _start(self, line: bytes, t: float) -> list[str]:
        """Begin with the command of a line; whoever sleeps hears only who wakes it."""
        text = line.decode("latin-1")
        if not text.strip():
            return []
        try:
            letter, words = parse_command(text)
        except CommandError:
            if self.state.asleep:
                return []
            raise
        if self.state.asleep and (letter != "A" or words == ["?"]):
            return []
        if words == ["?"]:
            self._begin(t, _COMMAND_TIME, lambda t: self._query_reply(letter, t))
        elif letter == "I":
            if parse_integer(letter, words):
                self.state.initialised = False
                self._begin(t, _INITIALISATION_TIME, self._initialise)
            else:
                self._begin(t, _COMMAND_TIME, self._confirm(letter))
        elif letter == "E":
            self.state.pending = parse_integer(letter, words)
            self._begin(t, self.state.pending * _EXERCISE_TIME, self._exercise)
        else:
            seconds = self._calculating if letter in "WD" else _COMMAND_TIME
            self._begin(t, seconds, lambda t: self._execute(letter, words, t))
        return []

    def _execute(self, letter: str, words: list[str], t: float) -> list[str]:
        if letter in "WP" and "error code" in self._faults:
            raise CommandError(8)
        execute(self.state, letter, words, self.serial)
        return self._confirm(letter)(t)

    def _initialise(self, t: float) -> list[str]:
        self.state.initialised = self.state.exercised = True
        shortest, longest = self._range
        at = self.state.wavelength or min(max(550.0, shortest), longest)
        self.state.tune(at)
        return self._confirm("I")(t)

    def _exercise(self, t: float) -> list[str]:
        self.state.pending, self.state.exercised = 0, True
        return self._confirm("E")(t)

    def _confirm(self, letter: str) -> Callable[[float], list[str]]:
        """What a command that was carried out answers: nothing, unless it is to confirm."""
        return lambda t: self._query_reply(letter, t) if self.state.brief == 2 else []

    def _query_reply(self, letter: str, t: float) -> list[str]:
        told = reply_lines(self.state, letter, self.serial, self.firmware, self._heat(t))
        if self.state.brief == 1:
            return [value.lstrip() for value in told]
        spelled = letter.lower() if letter in _LOWER else letter
        return [spelled + value for value in told]
