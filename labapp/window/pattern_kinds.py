"""The kinds of patterns that the window offers: all kinds of a plan file that have a title."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from labapp.files.grey_table import GREYS, ConstantPattern
from labapp.files.phase_table import FORMULAS, RingPattern, ZernikePattern
from labapp.files.table import Key, Table, keys_of, tag_of, unit_of
from labapp.files.target_table import SHAPES, TargetShape
from labapp.window.messages import PatternTable

Values = dict[str, Any]
"""What the fields of a page hold, by key."""


@dataclass(frozen=True)
class Number:
    """A number between two limits; whole numbers have no decimals."""

    key: str
    label: str
    unit: str
    low: float
    high: float
    first: float
    decimals: int = 2


@dataclass(frozen=True)
class Words:
    """A line of text."""

    key: str
    label: str
    first: str = ""
    longest: int = 80


@dataclass(frozen=True)
class PictureFile:
    """The path of a picture."""

    key: str
    hint: str


Field = Number | Words | PictureFile


@dataclass(frozen=True)
class Kind:
    """A kind by the name that the window remembers it by, and what a person calls it.

    table: of the fields' values, as a plan file writes the pattern. coded: whether it is made
    for a wavelength.
    """

    name: str
    title: str
    fields: tuple[Field, ...]
    table: Callable[[Values], PatternTable]
    coded: bool = True


_ABERRATIONS = {"defocus": (2, 0), "astigmatism": (2, 2), "coma": (3, 1), "spherical": (4, 0)}
"""Of the polynomials that a table of aberrations may name, those that have a field."""


def _kind(table: type[Table]) -> Kind:
    """The page of a kind: its keys that have a label."""
    if table is ZernikePattern:
        return Kind("zernike", table.title, tuple(_orders()), _aberrations)
    fields = tuple(_field(key, kind, told) for key, kind, told in keys_of(table) if told.label)
    if issubclass(table, TargetShape):
        shape = tag_of(table, "shape")
        return Kind(shape, table.title, fields, lambda values: _psf({"shape": shape} | values))
    name = tag_of(table, "kind")
    coded = table not in GREYS
    return Kind(name, table.title, fields, lambda values: {"kind": name} | values, coded)


def _field(key: str, kind: type[Any], told: Key) -> Field:
    if key == "file":
        return PictureFile(key, told.label)
    if kind is str:
        return Words(key, told.label, told.first, round(told.high))
    unit = unit_of(key)
    suffix = unit if unit in ("", "°") else f" {unit}"
    decimals = 0 if kind is int else 2
    return Number(key, told.label, suffix, told.low, told.high, told.first, decimals)


def _psf(target: PatternTable) -> PatternTable:
    return {"kind": "psf", "target": target}


def _orders() -> Iterator[Number]:
    for name in _ABERRATIONS:
        first = 100 if name == "spherical" else 0
        yield Number(name, name.capitalize(), " nm rms", -10_000, 10_000, first)


def _aberrations(values: Values) -> PatternTable:
    terms = [[n, m, values[name]] for name, (n, m) in _ABERRATIONS.items()]
    return {"kind": "zernike", "terms": terms}


_TABLES: tuple[type[Table], ...] = (ConstantPattern, RingPattern, *SHAPES, *FORMULAS, *GREYS[1:])

KINDS: tuple[Kind, ...] = tuple(_kind(one) for one in _TABLES if one.title)
"""Neutral first, then what has a shape, formulas, and files."""
