"""TOML and JSON from outside as plain data of bounded size and depth.

Only numbers are numbers: no text in quotes, and neither true nor false. pydantic takes "1_000" for
1000, true for 1, and 0.0 for false. Whole numbers may be written as 2.0, as some programs do. A
date is a text, and no number of seconds.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Callable
from datetime import datetime
from functools import cache, partial
from typing import Any

from pydantic_core import PydanticCustomError, core_schema

from labapp.common.errors import UserError
from labapp.common.number_ranges import require_range

MOST_TOML_BYTES = 1_000_000
"""Bytes of a TOML file, about a hundred times more than any that comes with labapp has. The worst
that was tried takes 270 MB and 2.3 s of processor time."""

MOST_JSON_BYTES = 64 << 20
"""Bytes of a JSON file, 64 MiB: a list of 200 000 training pictures. Chosen."""

_MOST_VALUES = 4_000_000
"""Values of a JSON file: PSFs of 60 bands in windows of 256 pixels. They take 250 MB. Chosen."""

_MOST_TABLES = 500_000
"""Lists and tables of a JSON file, each of which takes 70 bytes. Chosen."""

_MOST_LEVELS = 32
"""Levels of tables within tables, four times more than any of labapp's files has. Chosen."""

_INNER_PART = re.compile(r"\.[ \t]*[\w\"'-]+[ \t]*(?=\.)")
"""A part of a TOML key with a dot on both sides. Python takes a time for a key that grows with the
square of the number of its parts."""

_MOST_INTEGER = 1 << 63
"""Beyond the whole numbers of TOML (its specification 1.0) and of JSON as programs exchange it."""

_NOT_TEXT = re.compile("[\0\ud800-\udfff]")
"""Characters that neither files nor paths can hold."""

_OTHER_KEYS = ("metadata", "default", "serialization", "config", "expected", "keys_schema")
"""Keys of pydantic's schemas that hold no schema of a value in a file; TOML's keys are texts."""

_DIGITS = re.compile(r"\s*[+-]?[0-9_.]*\s*")


def parse_toml(text: str, source: str) -> dict[str, Any]:
    """Parse TOML; raise UserError, which begins with `source`, if it is invalid."""
    if any(len(_INNER_PART.findall(line)) > _MOST_LEVELS for line in text.splitlines()):
        raise _too_deep(source)
    data: dict[str, Any] = _parse(tomllib.loads, text, source, "TOML")
    return data


def parse_json(text: str, source: str) -> Any:
    """Parse JSON; raise UserError, which begins with `source`, if it is invalid."""
    if text.count(",") > _MOST_VALUES or text.count("[") + text.count("{") > _MOST_TABLES:
        raise UserError(f"{source}: has more values than labapp's files have. Give another file.")
    return _parse(json.loads, text, source, "JSON")


def _parse(parse: Callable[[str], Any], text: str, source: str, language: str) -> Any:
    """Parse a language's text; raise UserError if it is invalid, or isn't plain."""
    try:
        data = parse(text)
    except RecursionError as error:
        raise _too_deep(source) from error
    except ValueError as error:
        raise UserError(f"{source}: is not valid {language}: {error}") from error
    require_plain(data, source)
    return data


def require_plain(data: Any, source: str) -> None:
    """Raise UserError for data that are nested too deep or can't be written again.

    This is so for texts with NUL or half characters, and for whole numbers beyond 64 bits.
    """
    level = [data]
    for _ in range(_MOST_LEVELS):
        inner = []
        for one in level:
            members = one if isinstance(one, list) else [one]
            for value in [*one, *one.values()] if isinstance(one, dict) else members:
                if isinstance(value, str):
                    if found := _NOT_TEXT.search(value):
                        raise UserError(
                            f"{source}: has a text with the character U+{ord(found[0]):04X}, which "
                            "no file can hold. Remove it."
                        )
                elif isinstance(value, dict | list):
                    inner.append(value)
                elif isinstance(value, int) and not -_MOST_INTEGER <= value < _MOST_INTEGER:
                    raise UserError(
                        f"{source}: has a whole number beyond 64 bits. Write a smaller one."
                    )
        if not inner:
            return
        level = inner
    raise _too_deep(source)


def _too_deep(source: str) -> UserError:
    return UserError(
        f"{source}: is nested in more than {_MOST_LEVELS} levels, which no file of labapp is. "
        "Give another file."
    )


def only_numbers(source: Any, handler: Any) -> Any:
    """Return pydantic's schema of a table in which only numbers are taken for numbers.

    They are in the range of their unit, which the name of a key tells; see number_ranges.
    `source` and `handler` are those of `__get_pydantic_core_schema__`.
    """
    schema = handler(source)
    _tighten(handler.resolve_ref_schema(schema))
    return schema


def number_remedy(value: Any) -> str:
    """Say what should be written in place of a value that is no number."""
    if isinstance(value, bool):
        return "true and false are no numbers. Write a number"
    if not isinstance(value, str):
        return "write a number"
    from labapp.common.typed_numbers import parse_decimal

    try:
        return f"it is a text. Write {parse_decimal(value)}, without quotes"
    except ValueError:
        return "it is a text. Write a number, without quotes"


def _tighten(schema: Any, name: str = "") -> None:
    """Change a schema of pydantic's in place, with those within it.

    name: of a table's key.
    """
    for one in schema if isinstance(schema, list | tuple) else ():
        _tighten(one, name)
    if not isinstance(schema, dict):
        return
    kind = schema.get("type")
    name = schema["name"] if kind == "dataclass-field" else name
    if kind == "bool":
        schema["strict"] = True
    elif kind == "float":
        inner: Any = schema | {"strict": True}
        _replace(schema, _after(_range_check(name, positive=inner.get("gt") == 0), inner))
    elif kind == "int" and not {"le", "lt"} & schema.keys():
        inner = _before(_CHECKS[kind], dict(schema))
        _replace(schema, _after(_range_check(name, positive=False), inner))
    elif kind in _CHECKS and not any(isinstance(one, str) for one in schema.get("expected", ())):
        _replace(schema, _before(_CHECKS[kind], dict(schema)))
    elif not _is_checked(schema):
        for key, one in schema.items():
            if kind == "model-fields" and key == "fields":
                for field, inner in one.items():
                    _tighten(inner, field)
            elif key not in _OTHER_KEYS:
                _tighten(one, name)


_before = core_schema.no_info_before_validator_function
_after = core_schema.no_info_after_validator_function


def _replace(schema: dict[str, Any], by: Any) -> None:
    schema.clear()
    schema.update(by)


def _is_checked(schema: dict[str, Any]) -> bool:
    """Whether a schema of pydantic's has the checks already, which are put there once."""
    called = schema.get("function")
    return isinstance(called, dict) and getattr(called["function"], "is_check", False)


@cache
def _range_check(name: str, *, positive: bool) -> Any:
    """Return the check of a key's numbers, with their unit by the name of the key."""
    check: Any = partial(require_range, name, positive=positive)
    check.is_check = True
    return check


def _require_number(value: Any) -> Any:
    if isinstance(value, str | bytes | bool):
        raise PydanticCustomError("int_type", "Input should be a valid number")
    return value


def _refuse_truth(value: Any) -> Any:
    """Refuse true for the version 1, to which it is equal in Python."""
    if isinstance(value, bool):
        raise PydanticCustomError("int_type", "Input should be a valid number")
    return value


def _require_date(value: Any) -> Any:
    if isinstance(value, datetime) or (isinstance(value, str) and not _DIGITS.fullmatch(value)):
        return value
    raise PydanticCustomError(
        "date_text", "write date and time as a text, as in '2026-01-31T12:00:00Z'"
    )


_CHECKS = {"int": _require_number, "literal": _refuse_truth, "datetime": _require_date}
for _check in _CHECKS.values():
    _check.is_check = True  # type: ignore[attr-defined]
