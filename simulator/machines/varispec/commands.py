"""A VariSpec's commands as text, and its replies (manual 1.37, chapter 3)."""

from __future__ import annotations

import re

from simulator.machines.varispec.state import CommandError, VariSpecErrorCode, VariSpecState

_LINE = re.compile(r"\s*([A-Za-z])\s*(.*?)\s*")

_ILLEGAL = {
    "E": VariSpecErrorCode.ILLEGAL_EXERCISES,
    "I": VariSpecErrorCode.ILLEGAL_INITIALISATION,
    "M": VariSpecErrorCode.ILLEGAL_MODE,
    "G": VariSpecErrorCode.ILLEGAL_SYNC,
}
"""Error codes of illegal arguments, by command; other commands give a syntax error."""

_SETTINGS = {"B": "brief", "G": "sync", "M": "mode"}
"""Attributes of the state that a command sets to a number, by command."""

_STEPS = {">": 1, "<": -1}
"""Arguments for one step up or down, of the wavelength or in the palette."""

_LEGAL = {
    "B": range(3),
    "C": range(2),
    "E": range(256),
    "G": range(256),
    "I": range(2),
    "M": (0, 4),
    "R": range(2),
    "X": range(256),
}


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
    if letter in "VY":
        raise CommandError(VariSpecErrorCode.READ_ONLY)
    if letter in "AS":
        if parse_integer(letter, words) == serial:
            state.asleep = letter == "S"
    elif letter == "W":
        _tune(state, words)
    elif letter == "P":
        _choose(state, words)
    elif letter == "D":
        if not 1 <= len(words) <= 2:
            raise CommandError(VariSpecErrorCode.SYNTAX)
        element = int(parse_number(words[1])) if len(words) == 2 else None
        state.define(parse_number(words[0]), element)
    elif letter == "J":
        jump = parse_number(words[0]) if len(words) == 1 else float("nan")
        if not abs(jump) <= state.longest - state.shortest:
            code = VariSpecErrorCode
            raise CommandError(code.STEP_TOO_LARGE if len(words) == 1 else code.SYNTAX)
        state.jump = round(jump, 2)
    else:
        _set_integer(state, letter, parse_integer(letter, words))


def _tune(state: VariSpecState, words: list[str]) -> None:
    if len(words) != 1:
        raise CommandError(VariSpecErrorCode.SYNTAX)
    if words[0] in _STEPS:
        state.tune(state.wavelength + _STEPS[words[0]] * state.jump)
    else:
        state.tune(parse_number(words[0]))


def _choose(state: VariSpecState, words: list[str]) -> None:
    """Choose an element of the palette, as a command's argument says."""
    if len(words) == 1 and words[0] in _STEPS:
        state.choose_next(_STEPS[words[0]])
    else:
        state.choose(parse_integer("P", words))


def _set_integer(state: VariSpecState, letter: str, value: int) -> None:
    if letter in _SETTINGS:
        setattr(state, _SETTINGS[letter], value)
    elif letter == "R" and value:
        state.error = 0
    elif letter == "C" and value:
        state.palette.clear()
        state.element = 255
    elif letter == "X" and value:
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
    told = {
        "A": 1,
        "B": state.brief,
        "E": state.pending,
        "G": state.sync,
        "I": int(state.initialised),
        "M": state.mode,
        "P": state.element,
        "R": state.error,
        "S": 0,
    }
    return [f"{told.get(letter, 0):6d}"]
