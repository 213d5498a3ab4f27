"""TOML and JSON as validated tables, with errors that name file, key, value and remedy."""

from __future__ import annotations

from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError

from labapp.common.errors import UserError
from labapp.common.plain_text import quote
from labapp.files.guarded_reading import MOST_TEXT_BYTES, read_bytes
from labapp.files.plain_data import (
    MOST_JSON_BYTES,
    MOST_TOML_BYTES,
    number_remedy,
    only_numbers,
    parse_json,
    parse_toml,
)

M = TypeVar("M")


class FileModel(BaseModel):
    """Base of all tables in the application's files; unknown keys are errors, values are frozen.

    Texts, true and false aren't taken for numbers.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=True, defer_build=True)

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: Any) -> Any:
        return only_numbers(source, handler)


def bundled_path(name: str) -> Path:
    """Return the path of a data file that comes with the application."""
    return Path(str(resources.files("labapp") / "data" / name))


def read_text(
    path: Path, expected_content: str, most: int = MOST_TEXT_BYTES, *, any_encoding: bool = False
) -> str:
    """Return text in UTF-8, UTF-16 or UTF-32; UserError if it isn't such text.

    `expected_content` is what the error asks the user to give instead, and `most` the bytes that
    such a file has at most. With `any_encoding`, text may have one byte a letter, too; letters that
    can't be told are text_encoding.UNTOLD.
    """
    from labapp.files.text_encoding import decode_byte_text, decode_text

    data = read_bytes(path, most)
    text = decode_text(data)
    if text is not None:
        return text
    text = decode_byte_text(data)
    if text is None:
        raise UserError(f"{path}: is not a text file. Give {expected_content}.")
    if any_encoding:
        return text
    line = next(k for k, one in enumerate(data.splitlines(), 1) if not one.isascii())
    raise UserError(f"{path}: is text, but line {line} isn't in UTF-8. Save the file as UTF-8.")


def read_file(path: Path, model: type[M]) -> M:
    """Read TOML, or JSON if the name ends in .json, and validate it as a model.

    Raises UserError with file, key, value and rule.
    """
    is_json = path.suffix == ".json"
    most = MOST_JSON_BYTES if is_json else MOST_TOML_BYTES
    text = read_text(path, "a TOML or JSON file", most)
    data = parse_json(text, str(path)) if is_json else parse_toml(text, str(path))
    if not isinstance(data, dict):
        raise UserError(f"{path}: holds a {type(data).__name__}. Give an object of keys.")
    return validate(data, model, str(path))


def validate(data: dict[str, Any], model: type[M], source: str) -> M:
    """Validate plain data as a model; `source` names the file in UserErrors."""
    try:
        known: Any = model
        reader: TypeAdapter[M] = _adapter(known)
        return reader.validate_python(data)
    except ValidationError as error:
        raise UserError(format_validation_error(error, source)) from error


@lru_cache(maxsize=128)
def _adapter(model: Any) -> TypeAdapter[Any]:
    """Return pydantic's reader of a model, which takes tens of milliseconds to make."""
    return TypeAdapter(model)


def format_validation_error(error: ValidationError, source: str) -> str:
    """Return the first two problems of a validation as text, one per line."""
    every = error.errors()
    places = [problem["loc"] for problem in every]

    def holds_another(place: tuple[int | str, ...]) -> bool:
        return any(other != place and other[: len(place)] == place for other in places)

    # Tables that have a problem within them are left out.
    problems = [problem for problem in every if not holds_another(problem["loc"])]
    lines = [f"{source}: {_format_problem(dict(p))}" for p in problems[:2]]
    if len(problems) > 2:
        lines[-1] += f" (and {len(problems) - 2} more)"
    return "\n".join(lines)


def _format_problem(problem: dict[str, Any]) -> str:
    """Return a problem in words: key, value and remedy."""
    key = ".".join(str(part) for part in problem["loc"])
    if problem["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
        return f"key {quote(key)} is unknown. Remove it, or check its spelling."
    if problem["type"] == "missing":
        return f"key {quote(key)} is missing. Add it."
    message = problem["msg"].removeprefix("Value error, ")
    message = message[0].lower() + message[1:]
    if problem["type"] in ("float_type", "int_type"):
        message = number_remedy(problem["input"])
    elif problem["type"] == "bool_type":
        message = "write true or false, without quotes"
    if isinstance(problem["input"], dict):
        # The message leaves out the value of a whole table, which is long and tells little.
        return f"key {quote(key)}: {message}." if key else f"{message}."
    return f"key {quote(key)} is {quote(problem['input'])}: {message}."
