"""KEY=VALUE arguments of the command line, and descriptions of a table's keys."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Collection, Mapping, Sequence
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from labapp.common.errors import UserError
from labapp.common.typed_numbers import parse_number, parse_whole
from labapp.files.plain_data import parse_toml
from labapp.files.table import Key, unit_of


def parse_key_values(
    arguments: Sequence[str], model: type[Any], exclude: Collection[str] = ()
) -> dict[str, Any]:
    """Parse KEY=VALUE texts into TOML values by key, without validation.

    Values of text keys are kept as they are, and numbers are read as any that is typed. Keys in
    `exclude` aren't offered in errors. Raises UserError for an argument that isn't KEY=VALUE, or
    a number that can't be read.
    """
    fields, values = _fields(model), dict[str, Any]()
    for one in arguments:
        key, equals, text = one.partition("=")
        if not equals:
            known = ", ".join(key for key in fields if key not in exclude)
            raise UserError(f"{one!r} is no KEY=VALUE. The keys are {known}.")
        values[key] = _read_value(key, text, fields[key].annotation if key in fields else None)
    return values


def describe_keys(model: type[Any], exclude: Collection[str] = ()) -> list[dict[str, Any]]:
    """Return each key of a table with its default, unit and meaning, as text."""
    return [
        {"key": key, "default": _default(field), "what": _describe_key(key, field)}
        for key, field in _fields(model).items()
        if key not in exclude
    ]


def _fields(model: type[Any]) -> Mapping[str, FieldInfo]:
    """Return the keys of a pydantic model or a dataclass, with their fields."""
    if issubclass(model, BaseModel):
        return model.model_fields
    hints = get_type_hints(model, include_extras=True)
    return {
        one.name: FieldInfo.from_annotation(hints[one.name])
        if one.default is dataclasses.MISSING
        else FieldInfo.from_annotated_attribute(hints[one.name], one.default)
        for one in dataclasses.fields(model)
    }


def _read_value(key: str, text: str, kind: Any) -> Any:
    """Return the value that is typed for a key: text, a number, or what TOML makes of it."""
    if kind is str:
        return text
    try:
        value = parse_toml(f"value = {text}", "")["value"]
    except UserError:
        value = text
    kinds = _plain_types(kind)
    numeric = bool(kinds) and kinds <= {int, float}
    if value == math.inf or (
        not numeric and (isinstance(value, bool) or not isinstance(value, int | float))
    ):
        return value
    if isinstance(value, str) and not any(one.isnumeric() for one in text):
        # A word, of which the table says what would be right.
        return value
    unit = unit_of(key)
    try:
        if kinds == {int}:
            return parse_whole(text, unit)
        number = parse_number(text, unit)
        # As TOML would, whole ones as int.
        return int(number) if number.is_integer() else number
    except ValueError as error:
        raise UserError(f"key {key!r}: {error}.") from error


def _plain_types(kind: Any) -> set[Any]:
    """Return the types of a key's value, without None and without their ranges."""
    if get_origin(kind) is Annotated:
        return _plain_types(get_args(kind)[0])
    if get_origin(kind) in (Union, UnionType):
        return set().union(*(_plain_types(one) for one in get_args(kind)))
    return set() if kind is type(None) else {kind}


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "needed"
    value = field.default
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple) and value:
        return json.dumps(value)
    return "none" if value is None or value == () else str(value)


def _describe_key(key: str, field: FieldInfo) -> str:
    told = [one.description for one in field.metadata if isinstance(one, Key)]
    described = field.description or "".join(told[-1:])
    return f"{unit}, {described}" if (unit := unit_of(key)) else described
