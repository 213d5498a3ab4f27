"""Numbers of all commands, read by the one parser of typed numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, get_args

from labapp.common.errors import UserError
from labapp.common.number_ranges import require_range
from labapp.common.typed_numbers import parse_number, parse_whole

_UNITS = {"_nm": "nm", "_um": "µm", "_mm": "mm", "_ms": "ms", "_m": "m", "_s": "s", "_db": "dB"}
"""Units that may follow a number, by the ending of an option's name."""

_ENDLESS = ("distance", "focus", "speed")
"""Options that may be inf: objects and planes at infinity, and clocks that nobody waits for."""

_CLICK_NAMES = {"float": float, "float range": float, "integer": int, "integer range": int}
"""Types of the releases of Typer that are built on click, by their names there."""


def number_parameters(command: Any, words: tuple[str, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the words of each command, an option or argument of it that is a number, and its type.

    The type is int or float, also where the option takes several.
    """
    for one in command.params:
        if kind := _number_type(one):
            yield words, one, kind
    for name, part in getattr(command, "commands", {}).items():
        yield from number_parameters(part, (*words, name))


def read_numbers_as_typed(command: Any) -> None:
    """Let the one parser read every number of a command, and of those within it."""
    for _, one, kind in number_parameters(command):
        one.process_value = partial(_process, one, kind, one.process_value)


def _process(parameter: Any, kind: type, process: Callable[..., Any], *given: Any) -> Any:
    """Parse a number, several or none, before its range is checked."""
    *context, value = given
    if isinstance(value, list | tuple):
        value = type(value)(_parse(parameter, kind, one) for one in value)
    return process(*context, _parse(parameter, kind, value))


def _parse(parameter: Any, kind: type, value: Any) -> Any:
    """Parse a number; UserError names the option for what is none."""
    if not isinstance(value, str):
        return value
    if parameter.name in _ENDLESS and value.strip().lower() in ("inf", "+inf"):
        return math.inf
    unit = next((unit for end, unit in _UNITS.items() if parameter.name.endswith(end)), "")
    try:
        number = parse_whole(value, unit) if kind is int else parse_number(value, unit)
    except ValueError as error:
        raise UserError(f"{_name(parameter)} {error}.") from error
    try:
        return require_range(parameter.name, number, positive=True)
    except ValueError as error:
        raise UserError(f"{_name(parameter)} is {value}: {error}.") from error


def _name(parameter: Any) -> str:
    """Return the name of an option or argument as the user types it."""
    first: str = parameter.opts[0]
    return first if first.startswith("-") else first.upper()


def _number_type(parameter: Any) -> type | None:
    """Return the type, int or float, of a parameter that is a number, or None."""
    described = getattr(parameter, "type_descriptor", None)
    if described is None:
        return _CLICK_NAMES.get(parameter.type.name)
    kind = described.annotation
    kinds = get_args(kind) or (kind,)
    return kinds[0] if kinds[0] in (float, int) else None
