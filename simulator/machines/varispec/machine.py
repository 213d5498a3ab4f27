"""A VariSpec behind its serial port: echo, queue, immediate characters and time."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Literal

from simulator.machines.machine import FaultyMachine, Reply
from simulator.machines.varispec.commands import (
    CommandError,
    VariSpecErrorCode,
    VariSpecState,
    execute,
    parse_command,
    parse_integer,
    reply_lines,
)

_ESCAPE, _BUSY, _STATUS = b"\x1b", b"!", b"@"

_LOWER = "VBPM"  # letters that some firmware answers in lower case


# Seconds of an initialisation, of one exercise of the liquid crystals, and of an abort by ESC.
# Chosen.
_INITIALISATION, _EXERCISE, _ABORT = 30.0, 12.0, 0.02

# Seconds of any other command, by the manual "within a millisecond or two", and those in which
# the RS-232 electronics calculate the drive levels of a wavelength, chosen.
_COMMAND, _CALCULATION_RS232 = 0.0015, 0.3


def _warm_up_temperature(t: float) -> float:
    """Return a temperature in °C that rises by 4 K in about an hour."""
    return 25.0 - 4.0 * math.exp(-max(t, 0.0) / 1200.0)


class VariSpecMachine(FaultyMachine):
    """Simulate a VariSpec tunable filter by its user manual 1.37, over USB or RS-232.

    Parameters
    ----------
    range_nm : tuple of float, default (400.0, 720.0)
        Shortest and longest wavelength in nanometres.
    serial : int, default 50527
        Serial number, up to five digits.
    firmware : str, default "141"
        Version of the firmware, as the filter reports it.
    electronics : {"usb", "rs232"}, default "usb"
        Kind of electronics; "rs232" takes 0.3 s for a new wavelength.
    terminator : bytes, default b"\\r"
        Byte that ends commands and replies.
    powered_at : float, default -inf
        Time at which the filter was switched on, in seconds of the bench's clock.
    initialises : bool, default True
        Whether the filter initialises itself for 30 s when it is switched on.
    temperature : callable, optional
        Function from time in seconds to the temperature of the optics in °C; the default rises by
        4 K in about an hour.
    on_tuned : callable, optional
        Function that is called with each new wavelength, in metres.
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
        self.serial, self.firmware, self.terminator = serial, firmware, terminator
        self._calculating = {"usb": _COMMAND, "rs232": _CALCULATION_RS232}[electronics]
        self._heat, self._tell = temperature, on_tuned
        self._initialises, self._range = initialises, range_nm
        self.power_up(powered_at)

    def power_up(self, t: float) -> None:
        """Switch the filter on at time t, which resets its state."""
        shortest, longest = self._range
        self.state = VariSpecState(shortest, longest, lambda nm: self._tell(round(nm * 100) / 1e11))
        self._line = bytearray()
        self._queue: deque[bytes] = deque()
        self._finish: Callable[[float], list[str]] | None = None
        self._done_at = -math.inf
        if self._initialises:
            self._begin(t, _INITIALISATION, self._initialise)

    def feed(self, data: bytes, t: float) -> list[Reply]:
        replies = self._advance(t)
        for byte in data:
            replies += self._receive_byte(bytes([byte]), t)
            replies += self._advance(t)
        return replies

    def _receive_byte(self, byte: bytes, t: float) -> list[Reply]:
        echo = [Reply(t, byte)]
        if byte in (_ESCAPE, _BUSY, _STATUS):
            if self.state.asleep:
                return echo
            if byte == _ESCAPE:
                return echo + self._abort(t)
            if byte == _STATUS:
                # Bit 0 is set once the filter is initialised.
                status = self.state.status & (~1 if "uninitialised" in self._faults else ~0)
                return [*echo, Reply(t, bytes([status]))]
            waiting = self._finish is not None or self._queue or "busy forever" in self._faults
            return [*echo, Reply(t, b"<" if waiting else b">")]
        if byte == self.terminator:
            self._queue.append(bytes(self._line))
            self._line.clear()
        # The filter's input buffer holds 256 bytes.
        elif len(self._line) + sum(map(len, self._queue)) < 256:
            self._line += byte
        return echo

    def _abort(self, t: float) -> list[Reply]:
        self._queue.clear()
        self._line.clear()
        if self._finish is None:
            return []
        self.state.pending = 0
        self._begin(t, _ABORT, lambda t: [])
        return [Reply(self._done_at, b"")]

    def _advance(self, t: float) -> list[Reply]:
        """Finish the command that is due by time t, begin waiting ones, and return the replies."""
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
        """Do a command's work, and keep the error code if it fails."""
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
        """Keep the filter busy for some seconds, and then call `finish`."""
        self._finish, self._done_at = finish, t + seconds

    def _start(self, line: bytes, t: float) -> list[str]:
        """Begin the command that a line gives.

        A filter that is asleep obeys only the command to wake.
        """
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
            self._begin(t, _COMMAND, lambda t: self._query_reply(letter, t))
        elif letter == "I":
            if parse_integer(letter, words):
                self.state.initialised = False
                self._begin(t, _INITIALISATION, self._initialise)
            else:
                self._begin(t, _COMMAND, lambda t: self._confirm(letter, t))
        elif letter == "E":
            self.state.pending = parse_integer(letter, words)
            self._begin(t, self.state.pending * _EXERCISE, self._exercise)
        else:
            seconds = self._calculating if letter in "WD" else _COMMAND
            self._begin(t, seconds, lambda t: self._execute(letter, words, t))
        return []

    def _execute(self, letter: str, words: list[str], t: float) -> list[str]:
        if letter in "WP" and "error code" in self._faults:
            raise CommandError(VariSpecErrorCode.NO_DRIVE_LEVELS)
        execute(self.state, letter, words, self.serial)
        return self._confirm(letter, t)

    def _initialise(self, t: float) -> list[str]:
        self.state.initialised = self.state.exercised = True
        shortest, longest = self._range
        self.state.tune(self.state.wavelength or min(max(550.0, shortest), longest))
        return self._confirm("I", t)

    def _exercise(self, t: float) -> list[str]:
        self.state.pending, self.state.exercised = 0, True
        return self._confirm("E", t)

    def _confirm(self, letter: str, t: float) -> list[str]:
        """Make the reply to a completed command: none unless brief mode is 2."""
        return self._query_reply(letter, t) if self.state.brief == 2 else []

    def _query_reply(self, letter: str, t: float) -> list[str]:
        told = reply_lines(self.state, letter, self.serial, self.firmware, self._heat(t))
        if self.state.brief == 1:
            return [value.lstrip() for value in told]
        spelled = letter.lower() if letter in _LOWER else letter
        return [spelled + value for value in told]
