"""Which tests stay together in one worker: those of a file, of a fixture, of screens or of ports.

The workers collect, so they know it; they write it down for the scheduler.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import pytest

_IN_TURN = {"aravis": "ports", "xorg": "screens", "xvfb": "screens"}
"""Markers of tests that want a port or a screen for themselves. A camera's port is always the same
one, where an X server finds a free display: tests with both go with the ports."""


@dataclass
class Unit:
    """Tests, by their places in the collection, that one worker runs in this order.

    whole: no other worker may take a part of them, for what they share is made once.
    """

    tests: list[int] = field(default_factory=list)
    whole: bool = False


def units_of(items: Sequence[pytest.Item]) -> list[Unit]:
    by_file: dict[Path, list[int]] = {}
    for place, item in enumerate(items):
        by_file.setdefault(item.path, []).append(place)
    units: dict[str, Unit] = {}
    for path, places in by_file.items():
        shared = _what_they_share([items[place] for place in places])
        unit = units.setdefault(shared or str(path), Unit(whole=bool(shared)))
        unit.tests += places
    return list(units.values())


def _what_they_share(items: Sequence[pytest.Item]) -> str:
    """What the tests of a file share with each other or with those of other files, or ""."""
    fixtures = dict(fixture for item in items for fixture in _fixtures(item))
    in_turn = {what for item in items for name, what in _IN_TURN.items() if name in item.keywords}
    if in_turn or "display" in fixtures:
        return min(in_turn, default="screens")
    for name, scope in sorted(fixtures.items()):
        if scope == "session":
            return name
    return str(items[0].path) if "module" in fixtures.values() else ""


def _fixtures(item: pytest.Item) -> Iterator[tuple[str, str]]:
    """The fixtures of our own that a test asks for, and their scopes."""
    for name, found in item._fixtureinfo.name2fixturedefs.items():
        if found[-1].baseid and not found[-1]._autouse:
            yield name, found[-1].scope


def write_units(path: Path, items: Sequence[pytest.Item]) -> None:
    """Write them, at once: another worker may write the same while the scheduler reads."""
    part = path.with_suffix(f".{os.getpid()}")
    part.write_text(json.dumps([asdict(unit) for unit in units_of(items)]))
    part.replace(path)


def read_units(path: Path) -> list[Unit]:
    return [Unit(**unit) for unit in json.loads(path.read_text())]
