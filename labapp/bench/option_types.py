"""Checks that a device's options have the types that its driver declares."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Iterator, Mapping
from typing import Any

from labapp.common.number_ranges import require_range
from labapp.common.plain_text import quote
from labapp.files.plain_data import number_remedy

_NUMBER = re.compile(r"\b(?:float|int)\b")
_TEXT = re.compile(r"\b(?:str|Literal|Any)\b")


def require_option_types(signature: inspect.Signature, options: Mapping[str, Any]) -> None:
    """Refuse texts, true and false where a driver takes numbers alone.

    Numbers that nobody can mean by the option's unit are refused, too.
    Raises ValueError that names option, value and what to write.
    """
    for name, value in options.items():
        kind = _declared(signature, name)
        if kind == "bool" and not isinstance(value, bool):
            raise ValueError(f"{name} is {quote(value)}: write true or false, without quotes")
        if _NUMBER.search(kind) and not _TEXT.search(kind):
            for one in _leaves(value):
                if isinstance(one, str | bool):
                    raise ValueError(f"{name} has {quote(one)}: {number_remedy(one)}")
        for one in _leaves(value):
            if isinstance(one, int | float) and not isinstance(one, bool):
                _require_range(name, one)


def _require_range(name: str, value: float) -> None:
    """Refuse a number that isn't finite, or beyond the range of the option's unit."""
    try:
        if not math.isfinite(value):
            raise ValueError("give a finite number")
        require_range(name, value, positive=True)
    except ValueError as error:
        raise ValueError(f"{name} has {value:g}: {error}") from error


def _declared(signature: inspect.Signature, name: str) -> str:
    """Return the type that a driver declares for an option, as text."""
    found = signature.parameters.get(name)
    if found is None or found.annotation is inspect.Parameter.empty:
        return ""
    kind = found.annotation
    return kind.__name__ if isinstance(kind, type) else str(kind)


def _leaves(value: Any) -> Iterator[Any]:
    """Yield a value, or those of its list and of the lists in it."""
    if isinstance(value, list | tuple):
        for one in value:
            yield from _leaves(one)
    else:
        yield value
