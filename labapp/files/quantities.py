"""Numbers in files and requests: types with their allowed ranges, and exposures.

Exposures are whole microseconds, as cameras count, so that equal ones are equal numbers.

Only numbers are numbers: no text in quotes, and neither true nor false. pydantic takes "1_000" for
1000, true for 1, and 0.0 for false. Whole numbers may be written as 2.0, as some programs do. A
date is a text, and no number of seconds.
"""

from __future__ import annotations

import re
from datetime import datetime
from typing import Annotated, Any

from pydantic import Field
from pydantic_core import PydanticCustomError, core_schema

from labapp.files.table import LightUnit

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Nanometres = Annotated[Positive, LightUnit()]
"""Wavelength of light in nanometres."""

NanometresText = Annotated[str, Field(pattern=r"^[0-9]+(\.[0-9]+)?$"), LightUnit()]
"""Wavelength of light in nanometres as the key of a table."""

Amount = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0, le=1)]

_OTHER_KEYS = ("metadata", "default", "serialization", "config", "expected", "keys_schema")
"""Keys of pydantic's schemas that hold no schema of a value in a file; TOML's keys are texts."""

_DIGITS = re.compile(r"\s*[+-]?[0-9_.]*\s*")


def round_exposure(seconds: float) -> float:
    """Return an exposure in seconds, rounded to whole microseconds."""
    return round(seconds * 1e6) / 1e6


def exposure_from_ms(milliseconds: float) -> float:
    """Return an exposure of a plan in seconds, rounded to whole microseconds."""
    return round(milliseconds * 1e3) / 1e6


def exposure_in_ms(seconds: float) -> float:
    """Return an exposure in milliseconds for a plan, rounded to whole microseconds."""
    return round(seconds * 1e6) / 1e3


def only_numbers(source: Any, handler: Any) -> Any:
    """Return pydantic's schema of a file's table, in which only numbers are taken for numbers.

    `source` and `handler` are those of `__get_pydantic_core_schema__`.
    """
    schema = handler(source)
    _tighten(handler.resolve_ref_schema(schema))
    return schema


def number_remedy(value: Any) -> str:
    """Say what a file should have in place of a value that is no number."""
    if isinstance(value, bool):
        return "true and false are no numbers. Write a number"
    if not isinstance(value, str):
        return "write a number"
    from labapp.common.typed_numbers import parse_decimal

    try:
        return f"it is a text. Write {parse_decimal(value)}, without quotes"
    except ValueError:
        return "it is a text. Write a number, without quotes"


def _tighten(schema: Any) -> None:
    """Change a schema of pydantic's in place, with those within it."""
    for one in schema if isinstance(schema, list | tuple) else ():
        _tighten(one)
    if not isinstance(schema, dict):
        return
    kind = schema.get("type")
    if kind in ("float", "bool"):
        schema["strict"] = True
    elif kind in _CHECKS and not any(isinstance(one, str) for one in schema.get("expected", ())):
        inner = dict(schema)
        schema.clear()
        schema.update(core_schema.no_info_before_validator_function(_CHECKS[kind], inner))
    elif schema.get("function", {}) not in _CHECKED:
        for key, one in schema.items():
            if key not in _OTHER_KEYS:
                _tighten(one)


def _require_number(value: Any) -> Any:
    if isinstance(value, str | bytes | bool):
        raise PydanticCustomError("int_type", "Input should be a valid number")
    return value


def _refuse_truth(value: Any) -> Any:
    """Refuse true for the file's version 1, to which it is equal in Python."""
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
_CHECKED = [{"type": "no-info", "function": one} for one in _CHECKS.values()]
"""How pydantic's schemas name the checks, which are put there once."""
