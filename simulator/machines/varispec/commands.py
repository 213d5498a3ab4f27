"""A VariSpec's state, and its commands and replies as text (user manual 1.37, chapter 3, table 3).

Wavelengths are in nanometres here, as on the wire.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import IntEnum

NONE_CHOSEN = 255
"""Number that stands for the palette's element while none is chosen."""


class VariSpecErrorCode(IntEnum):
    """Error codes of a VariSpec, as the query `R ?` reports them."""

    SYNTAX = 1
    READ_ONLY = 2
    ILLEGAL_EXERCISES = 3
    NOT_INITIALISED = 4
    ILLEGAL_INITIALISATION = 5
    ILLEGAL_MODE = 7
    NO_DRIVE_LEVELS = 8
    NO_PALETTE = 9
    NO_SUCH_ELEMENT = 11
    WAVELENGTH_OUT_OF_RANGE = 12
    STEP_TOO_LARGE = 14
    ILLEGAL_SYNC = 17


class CommandError(Exception):
    """Raised when a VariSpec can't carry out a command. code: what `R ?` reports afterwards."""

    def __init__(self, code: VariSpecErrorCode) -> None:
        super().__init__(code)
        self.code = code


@dataclass
class VariSpecState:
    """State of a VariSpec that commands can set.

    shortest, longest: wavelengths of the optics. on_tuned: called with each wavelength that is set.
    """

    shortest: float
    longest: float
    on_tuned: Callable[[float], None]
    wavelength: float = 0.0
    initialised: bool = False
    exercised: bool = False
    error: int = 0
    brief: int = 0
    sync: int = 1
    mode: int = 0
    jump: float = 5.0
    palette: list[float] = field(default_factory=list)
    element: int = NONE_CHOSEN
    pending: int = 0
    asleep: bool = False

    def _require_initialised(self) -> None:
        if not self.initialised:
            raise CommandError(VariSpecErrorCode.NOT_INITIALISED)

    def tune(self, wavelength: float) -> None:
        self._require_initialised()
        if not self.shortest <= wavelength <= self.longest:
            raise CommandError(VariSpecErrorCode.WAVELENGTH_OUT_OF_RANGE)
        self.wavelength = round(wavelength, 2)
        self.on_tuned(self.wavelength)

    def define(self, wavelength: float, element: int | None) -> None:
        """Add, replace or delete (wavelength -1) an element of the palette."""
        self._require_initialised()
        count = len(self.palette)
        element = count if element is None else element
        if wavelength == -1:
            if not 0 <= element < count:
                raise CommandError(VariSpecErrorCode.NO_SUCH_ELEMENT)
            del self.palette[element]
            return
        if not self.shortest <= wavelength <= self.longest:
            raise CommandError(VariSpecErrorCode.WAVELENGTH_OUT_OF_RANGE)
        # The palette holds 128 elements at most.
        if not 0 <= element <= min(count, 127):
            raise CommandError(VariSpecErrorCode.NO_SUCH_ELEMENT)
        self.palette[element : element + 1] = [round(wavelength, 2)]

    def choose(self, element: int) -> None:
        self._require_initialised()
        if not self.palette:
            raise CommandError(VariSpecErrorCode.NO_PALETTE)
        if not 0 <= element < len(self.palette):
            raise CommandError(VariSpecErrorCode.NO_SUCH_ELEMENT)
        self.element = element
        self.tune(self.palette[element])

    def choose_next(self, step: int) -> None:
        """Choose the next or previous element of the palette, cyclically."""
        if not self.palette:
            raise CommandError(VariSpecErrorCode.NO_PALETTE)
        first = 0 if step > 0 else len(self.palette) - 1
        chosen = self.element != NONE_CHOSEN
        self.choose((self.element + step) % len(self.palette) if chosen else first)

    def pulse(self) -> None:
        """Carry out the effect of a pulse at the sync port."""
        if self.mode == 4:
            self.tune(self.wavelength + self.jump)
        else:
            self.choose_next(1)

    @property
    def status(self) -> int:
        """Return the status bits, the reply to `@` (table 2 of the manual)."""
        told = self.initialised, self.exercised, self.palette, self.brief, False, self.error, True
        return sum(1 << place for place, bit in enumerate(told) if bit)


_LINE = re.compile(r"\s*([A-Za-z])\s*(.*?)\s*")

# Error codes of illegal arguments, by command; other commands give a syntax error.
_ILLEGAL = {
    "E": VariSpecErrorCode.ILLEGAL_EXERCISES,
    "I": VariSpecErrorCode.ILLEGAL_INITIALISATION,
    "M": VariSpecErrorCode.ILLEGAL_MODE,
    "G": VariSpecErrorCode.ILLEGAL_SYNC,
}

_STEPS = {">": 1, "<": -1}  # arguments for one step up or down, of the wavelength or in the palette

_LEGAL = {"B": range(3), "M": (0, 4)}
_LEGAL |= dict.fromkeys("CIR", range(2)) | dict.fromkeys("EGX", range(256))
"""Whole numbers that commands take."""


def parse_command(line: str) -> tuple[str, list[str]]:
    """Split a command into its letter and arguments.

    Raises CommandError if the line is no command.
    """
    found = _LINE.fullmatch(line)
    if not found or found[1].upper() not in "ABCDEGIJMPRSVWXY":
        raise CommandError(VariSpecErrorCode.SYNTAX)
    return found[1].upper(), [word for word in re.split(r"[,\s]+", found[2]) if word]


def parse_number(word: str) -> float:
    if not re.fullmatch(r"[+-]?(\d+\.?\d*|\.\d+)", word):
        raise CommandError(VariSpecErrorCode.SYNTAX)
    return float(word)


def parse_integer(letter: str, words: list[str]) -> int:
    """Return a command's only argument, a whole number.

    Raises CommandError for more or fewer arguments, and for a number that the command doesn't take.
    """
    if len(words) != 1:
        raise CommandError(VariSpecErrorCode.SYNTAX)
    value = parse_number(words[0])
    if value not in _LEGAL.get(letter, (value,)):
        raise CommandError(_ILLEGAL.get(letter, VariSpecErrorCode.SYNTAX))
    return int(value)


def execute(state: VariSpecState, letter: str, words: list[str], serial: int) -> None:
    """Change a VariSpec's state by a command other than I and E, which take time."""
    code = VariSpecErrorCode
    match letter:
        case "V" | "Y":
            raise CommandError(code.READ_ONLY)
        case "A" | "S":
            if parse_integer(letter, words) == serial:
                state.asleep = letter == "S"
        case "W":
            if len(words) != 1:
                raise CommandError(code.SYNTAX)
            step = _STEPS.get(words[0])
            state.tune(state.wavelength + step * state.jump if step else parse_number(words[0]))
        case "P" if len(words) == 1 and words[0] in _STEPS:
            state.choose_next(_STEPS[words[0]])
        case "P":
            state.choose(parse_integer("P", words))
        case "D":
            if not 1 <= len(words) <= 2:
                raise CommandError(code.SYNTAX)
            element = int(parse_number(words[1])) if len(words) == 2 else None
            state.define(parse_number(words[0]), element)
        case "J":
            if len(words) != 1:
                raise CommandError(code.SYNTAX)
            jump = parse_number(words[0])
            if not abs(jump) <= state.longest - state.shortest:
                raise CommandError(code.STEP_TOO_LARGE)
            state.jump = round(jump, 2)
        case _:
            _set_integer(state, letter, parse_integer(letter, words))


def _set_integer(state: VariSpecState, letter: str, value: int) -> None:
    match letter:
        case "B":
            state.brief = value
        case "G":
            state.sync = value
        case "M":
            state.mode = value
        case "R" if value:
            state.error = 0
        case "C" if value:
            state.palette.clear()
            state.element = NONE_CHOSEN
        case "X" if value:
            state.pulse()


def reply_lines(
    state: VariSpecState, letter: str, serial: int, firmware: str, heat: float
) -> list[str]:
    """Return the lines of the reply to a query, padded as the manual says."""
    if letter == "V":
        optics = f"{state.shortest:.2f}  {state.longest:.2f}"
        return [f"   {firmware}  {optics} {serial:05d}"]
    if letter == "Y":
        return [f"{heat:7.2f}"]
    if letter == "W":
        return [f"{state.wavelength:7.2f}" if state.initialised else "*"]
    if letter == "J":
        return [f"{state.jump:7.2f}"]
    if letter == "D":
        return [f"{len(state.palette):6d}", *(f"{one:7.2f}" for one in state.palette)]
    told = {"A": 1, "B": state.brief, "E": state.pending, "G": state.sync, "M": state.mode}
    told |= {"I": int(state.initialised), "P": state.element, "R": state.error}
    return [f"{told.get(letter, 0):6d}"]
