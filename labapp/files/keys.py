"""KEY=VALUE on a command line: a table's keys, and what a person is told of them."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Collection, Sequence
from typing import Any

from pydantic.fields import FieldInfo

from labapp.common.errors import UserError
from labapp.files.reading import FileModel

_UNITS = {
    "um_per_nm": "µm a nm",
    "_nm": "nm",
    "_um": "µm",
    "_mm": "mm",
    "_ms": "ms",
    "_m": "m",
    "_rad": "rad",
    "_deg": "°",
    "_px": "pixels",
    "_s": "s",
}


def read_keys(
    given: Sequence[str], model: type[FileModel], but: Collection[str] = ()
) -> dict[str, Any]:
    """Values by key, read as TOML unless the key is for text; they aren't validated yet.

    but: keys that nobody gives. UserError for what is no KEY=VALUE.
    """
    fields, values = model.model_fields, dict[str, Any]()
    for one in given:
        key, equals, text = one.partition("=")
        if not equals:
            known = ", ".join(key for key in fields if key not in but)
            raise UserError(f"{one!r} is no KEY=VALUE. The keys are {known}.")
        is_text = key in fields and fields[key].annotation is str
        values[key] = text if is_text else _as_toml(text)
    return values


def described_keys(model: type[FileModel], but: Collection[str] = ()) -> list[dict[str, Any]]:
    """Each key with its default, and its unit and meaning, as words."""
    return [
        {"key": key, "default": _default(field), "what": _what(key, field)}
        for key, field in model.model_fields.items()
        if key not in but
    ]


def unit_of(key: str) -> str:
    """The unit that a key's name ends in; empty where it has none."""
    return next((unit for end, unit in _UNITS.items() if key.endswith(end)), "")


def _as_toml(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


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


def _what(key: str, field: FieldInfo) -> str:
    described, unit = field.description or "", unit_of(key)
    return f"{unit}, {described}" if unit else described
