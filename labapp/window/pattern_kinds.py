"""Kinds of patterns to choose from: all kinds of a plan file that have a title."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from labapp.files.formula_patterns import FORMULA_PATTERNS
from labapp.files.grey_table import GREY_PATTERNS, ConstantPattern
from labapp.files.phase_table import RingPattern, ZernikePattern
from labapp.files.table import Key, Table, keys_of, tag_value, unit_of
from labapp.files.target_table import TARGET_SHAPES, TargetShape
from labapp.window.commands import PatternTable

Values = dict[str, Any]
"""Values of the fields of a form's page, by key."""


@dataclass(frozen=True)
class NumberField:
    """A field for a number between two limits; a whole number has no decimals."""

    key: str
    label: str
    unit: str
    low: float
    high: float
    initial: float
    decimals: int = 2


@dataclass(frozen=True)
class TextField:
    """A field for a line of text."""

    key: str
    label: str
    initial: str = ""
    longest: int = 80


@dataclass(frozen=True)
class FileField:
    """A field for the path of a picture."""

    key: str
    hint: str


PatternField = NumberField | TextField | FileField


@dataclass(frozen=True)
class PatternKind:
    """A kind of pattern to choose.

    name: what the kind's fields are saved under.
    build_table: turns the fields' values into the pattern's table of a plan file.
    needs_wavelength: whether the pattern is designed for a wavelength.
    """

    name: str
    title: str
    fields: tuple[PatternField, ...]
    build_table: Callable[[Values], PatternTable]
    needs_wavelength: bool = True


_ABERRATIONS = {"defocus": (2, 0), "astigmatism": (2, 2), "coma": (3, 1), "spherical": (4, 0)}
"""Degree n and order m of the Zernike polynomials that have a field in the form."""


def _kind(table: type[Table]) -> PatternKind:
    """Describe a kind of pattern: a field for each key that has a label."""
    if table is ZernikePattern:
        return PatternKind("zernike", table.title, tuple(_orders()), _aberrations)
    fields = tuple(_field(key, kind, told) for key, kind, told in keys_of(table) if told.label)
    if issubclass(table, TargetShape):
        shape = tag_value(table, "shape")
        return PatternKind(
            shape, table.title, fields, lambda values: _psf({"shape": shape} | values)
        )
    name = tag_value(table, "kind")
    coded = table not in GREY_PATTERNS
    return PatternKind(name, table.title, fields, lambda values: {"kind": name} | values, coded)


def _field(key: str, kind: type[Any], key_info: Key) -> PatternField:
    """Describe the input field for a key of a pattern."""
    if key == "file":
        return FileField(key, key_info.label)
    if kind is str:
        return TextField(key, key_info.label, key_info.initial, round(key_info.high))
    unit = unit_of(key)
    suffix = unit if unit in ("", "°") else f" {unit}"
    decimals = 0 if kind is int else 2
    return NumberField(
        key, key_info.label, suffix, key_info.low, key_info.high, key_info.initial, decimals
    )


def _psf(target: PatternTable) -> PatternTable:
    return {"kind": "psf", "target": target}


def _orders() -> Iterator[NumberField]:
    for name in _ABERRATIONS:
        first = 100 if name == "spherical" else 0
        yield NumberField(name, name.capitalize(), " nm rms", -10_000, 10_000, first)


def _aberrations(values: Values) -> PatternTable:
    terms = [[n, m, values[name]] for name, (n, m) in _ABERRATIONS.items()]
    return {"kind": "zernike", "terms": terms}


_TABLES: tuple[type[Table], ...] = (
    ConstantPattern,
    RingPattern,
    *TARGET_SHAPES,
    *FORMULA_PATTERNS,
    *GREY_PATTERNS[1:],
)

PATTERN_KINDS: tuple[PatternKind, ...] = tuple(_kind(one) for one in _TABLES if one.title)
"""The kinds in the order of their list: neutral, PSF shapes, formulas, and files."""
