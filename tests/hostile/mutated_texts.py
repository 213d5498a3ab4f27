"""Texts of files mutated by seed: characters, lines, numbers, types, keys, tables, encodings."""

from __future__ import annotations

import copy
import json
import random
import re
import tomllib
from collections.abc import Callable, Iterator
from typing import Any

_NUMBERS: tuple[Any, ...] = (
    1e308, -1e308, 1.7e308, 1e300, 1e200, 1e155, 1e100, 1e39, 1e38, 1e30, 1e20, 1e19, 1e12, 1e9,
    1e6, 1e-6, 1e-12, 1e-20, 1e-39, 1e-46, 1e-100, 1e-155, 1e-200, 1e-308, 5e-324, -5e-324, 0.0,
    -0.0, 0, -1, 1, 2, 255, 256, 65_535, 65_536, 99_999, 100_000, 2**31 - 1, 2**31, 2**32,
    2**53 + 1, 2**63 - 1, -(2**63), float("inf"), float("-inf"), float("nan"), 0.1 + 0.2, 1 - 1e-16,
)  # fmt: skip
"""At the ends of what doubles, singles and integers hold, and of their squares and roots."""

_VALUES: tuple[Any, ...] = (
    "", "0", "1e308", "nan", "-", "x" * 300, "../../etc", "é\u202e\x1b[2J", True, False, [], {},
    [[]], [1e308, 1e308], [0.0], {"a": 1}, {"file": "gone.csv"}, [1, "a"], [[1, 2], [3]],
)  # fmt: skip

_DRIVERS = (
    "simulated-slm", "simulated-filter", "simulated-wheel", "simulated-camera", "simulated-targets",
    "simulated-spectroradiometer", "manual-targets", "varispec", "thorlabs-wheel", "screen-slm",
    "starlight-wheel", "zwo-wheel", "aravis-camera", "uvc-camera", "cs2000",
)  # fmt: skip

_LITERAL = re.compile(r"(?<![\w\"])-?\d+\.?\d*(?:e[+-]?\d+)?")

Path = tuple[Any, ...]


def mutate(text: str, kind: str, rng: random.Random) -> bytes:
    """A text with one to four mutations. kind: "toml", "json" or "csv"."""
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        if kind != "csv" and rng.random() < 0.7:
            text = _mutate_tables(text, kind, rng)
        else:
            text = rng.choice(_TEXT_MUTATIONS)(text, rng)
    return _encode(text, rng)


def _mutate_tables(text: str, kind: str, rng: random.Random) -> str:
    """Parse, mutate the data and write it again; a text that isn't sound is mutated as text."""
    try:
        data = parsed(text, kind)
    except ValueError:
        return rng.choice(_TEXT_MUTATIONS)(text, rng)
    rng.choice(_TABLE_MUTATIONS)(data, rng)
    return as_text(data, kind)


def parsed(text: str, kind: str) -> Any:
    return json.loads(text) if kind == "json" else tomllib.loads(text)


def as_text(data: Any, kind: str) -> str:
    """The text of a file with the data; of a list or text in the place of tables, too."""
    if kind == "json" or not isinstance(data, dict):
        return json.dumps(data, indent=1)
    return "".join(f"{_key(key)} = {_toml(value)}\n" for key, value in data.items())


def places(data: Any, above: Path = ()) -> Iterator[Path]:
    """Where each value of nested tables and lists stands."""
    pairs = data.items() if isinstance(data, dict) else enumerate(data)
    for key, value in pairs:
        yield (*above, key)
        if isinstance(value, dict | list):
            yield from places(value, (*above, key))


def _at(data: Any, place: Path) -> Any:
    for key in place:
        data = data[key]
    return data


def _pick(data: Any, rng: random.Random, fits: Callable[[Any], bool]) -> Path | None:
    found = [place for place in places(data) if fits(_at(data, place))]
    return rng.choice(found) if found else None


def _replacing(fits: Callable[[Any], bool], values: tuple[Any, ...]) -> Any:
    def change(data: Any, rng: random.Random) -> None:
        if (place := _pick(data, rng, fits)) is not None:
            _at(data, place[:-1])[place[-1]] = copy.deepcopy(rng.choice(values))

    return change


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _scale(data: Any, rng: random.Random) -> None:
    """A number in another unit, or with another sign."""
    if (place := _pick(data, rng, _is_number)) is not None:
        _at(data, place[:-1])[place[-1]] *= rng.choice((-1, 1e3, 1e-3, 1e6, 1e-6, 1e9, 1e-9, 1e18))


def _move(data: Any, rng: random.Random) -> None:
    """A key with its value stands in another table; it may stay in its own, too."""
    place = _pick(data, rng, lambda value: True)
    table = _pick(data, rng, lambda value: isinstance(value, dict))
    if place is None:
        return
    target = _at(data, table) if table is not None else data
    value = copy.deepcopy(_at(data, place))
    if rng.random() < 0.7:
        del _at(data, place[:-1])[place[-1]]
    if isinstance(target, dict):
        target[str(place[-1])] = value


def _exchange(data: Any, rng: random.Random) -> None:
    """Two values change places, tables of devices among them."""
    one, other = (_pick(data, rng, lambda value: True) for _ in range(2))
    if one is None or other is None or one[: len(other)] == other or other[: len(one)] == one:
        return
    first, second = copy.deepcopy(_at(data, one)), copy.deepcopy(_at(data, other))
    _at(data, one[:-1])[one[-1]], _at(data, other[:-1])[other[-1]] = second, first


def _drop(data: Any, rng: random.Random) -> None:
    if (place := _pick(data, rng, lambda value: True)) is not None:
        del _at(data, place[:-1])[place[-1]]


def _repeat(data: Any, rng: random.Random) -> None:
    """A list is many times as long, or a table has each entry once more by another name."""
    place = _pick(data, rng, lambda value: bool(value) and isinstance(value, dict | list))
    if place is None:
        return
    value = _at(data, place)
    if isinstance(value, list):
        _at(data, place[:-1])[place[-1]] = value * rng.choice((2, 3, 100, 2000))
    else:
        value |= {f"{key}2": copy.deepcopy(one) for key, one in value.items()}


def _rename(data: Any, rng: random.Random) -> None:
    place = _pick(data, rng, lambda value: True)
    if place is not None and isinstance(table := _at(data, place[:-1]), dict):
        table[rng.choice(("x", "1e308", "nan", "-5", "", "532", "1e-308"))] = table.pop(place[-1])


_TABLE_MUTATIONS: tuple[Callable[[Any, random.Random], None], ...] = (
    *(4 * (_replacing(_is_number, _NUMBERS),)), _scale, _scale, _move, _exchange, _drop, _repeat,
    _rename, _replacing(lambda value: True, _VALUES), _replacing(lambda value: True, _NUMBERS),
    _replacing(lambda value: value in _DRIVERS, _DRIVERS),
)  # fmt: skip


def _put_number(text: str, rng: random.Random) -> str:
    if not (found := list(_LITERAL.finditer(text))):
        return text
    one = rng.choice(found)
    return text[: one.start()] + f"{rng.choice(_NUMBERS)!r}" + text[one.end() :]


def _overwrite(text: str, rng: random.Random) -> str:
    at = rng.randrange(len(text) + 1)
    return text[:at] + chr(rng.choice((0, 9, 10, 13, 27, 34, 44, 61, 0x202E, 0xFEFF))) + text[at:]


def _shift_lines(text: str, rng: random.Random) -> str:
    lines = text.split("\n")
    line = lines[rng.randrange(len(lines))]
    if rng.random() < 0.5:
        lines.remove(line)
    lines.insert(rng.randrange(len(lines) + 1), line)
    return "\n".join(lines)


def _truncate(text: str, rng: random.Random) -> str:
    return text[: rng.randrange(len(text) + 1)]


def _swap_signs(text: str, rng: random.Random) -> str:
    """Decimal commas, semicolons, tabs and line ends of other programs."""
    old, new = rng.choice(((".", ","), (",", ";"), (",", "\t"), ("\n", "\r\n"), ("\n", "\r")))
    return text.replace(old, new)


_TEXT_MUTATIONS = (
    _put_number, _put_number, _put_number, _overwrite, _shift_lines, _truncate, _swap_signs,
)  # fmt: skip


def _encode(text: str, rng: random.Random) -> bytes:
    coding = rng.choice((*["utf-8"] * 30, "utf-8-sig", "utf-16", "utf-32", "latin-1", "cp1252"))
    return text.encode(coding, "replace")


def _key(key: Any) -> str:
    return json.dumps(str(key))


def _toml(value: Any) -> str:
    """As TOML, with tables in braces."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_key(k)} = {_toml(one)}" for k, one in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    if isinstance(value, float):
        return repr(value)
    return json.dumps(value) if isinstance(value, str | bool | int) else json.dumps(str(value))
