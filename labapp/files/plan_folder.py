"""A plan that the application made: written as TOML, with its patterns as pictures beside it."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.plan_file import PlanFile
from labapp.files.writing import encode_image, make_folder, write_atomically

PLAN_FILE, RECORD_FILE = "plan.toml", "run.h5"
"""Names of a plan that the application made, and of the record of its run."""

PATTERN_FOLDER = "patterns"
"""Name of the folder of the patterns' pictures, beside the plan."""


def write_plan(folder: Path, plan: PlanFile, patterns: Mapping[str, NDArray[np.uint8]]) -> Path:
    """Write plan.toml, and patterns/*.png if any, into a folder; return the plan's path.

    Raises UserError if they can't be written.
    """
    pictures = folder / PATTERN_FOLDER
    make_folder(pictures if patterns else folder)
    path = folder / PLAN_FILE
    try:
        for name, grey in patterns.items():
            picture = pictures / f"{name}.png"
            write_atomically(picture, encode_image(picture, grey))
        write_atomically(
            path, as_toml(plan.model_dump(mode="json", exclude_defaults=True)).encode()
        )
    except OSError as error:
        raise UserError(
            f"{folder}: cannot be written: {error.strerror}. Choose another place."
        ) from error
    return path


def as_toml(data: Mapping[str, Any]) -> str:
    """Return plain data as TOML: keys, then tables, then lists of tables."""
    plain = {k: v for k, v in data.items() if not isinstance(v, dict) and not _tables(v)}
    lines = [f"{key} = {_value(value)}" for key, value in plain.items()]
    for key, value in data.items():
        if isinstance(value, dict):
            lines += ["", f"[{key}]", *(f"{_key(k)} = {_value(v)}" for k, v in value.items())]
    for key, value in data.items():
        for row in value if _tables(value) else ():
            lines += ["", f"[[{key}]]", *(f"{_key(k)} = {_value(v)}" for k, v in row.items())]
    return "\n".join(lines) + "\n"


def _tables(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], dict)


def _key(key: str) -> str:
    plain = key.replace("-", "").replace("_", "")
    return key if plain.isascii() and plain.isalnum() else json.dumps(key)


def _value(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{_key(k)} = {_value(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    if isinstance(value, float) and not math.isfinite(value):
        return repr(value)
    # TOML writes strings, finite numbers and booleans as JSON does.
    return json.dumps(value, ensure_ascii=False)
