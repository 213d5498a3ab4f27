"""Prints the lists of the command line in one layout, or as JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from labapp.common.console import out, print_json


@dataclass(frozen=True)
class ListEntry:
    """One entry of a list: its name and one sentence.

    keys: its settings, each with `key`, `default` and `what`.
    lines: further lines for users.
    facts: further data for programs.
    """

    name: str
    what: str
    keys: Sequence[Mapping[str, str]] = ()
    lines: Sequence[str] = ()
    facts: Mapping[str, Any] = field(default_factory=dict)


def print_list(
    entries: Sequence[ListEntry],
    *,
    as_json: bool,
    common_keys: Sequence[Mapping[str, str]] = (),
    example: str,
) -> None:
    """Print a list as JSON with all data, or as text that shows common keys once.

    common_keys: keys that most entries have.
    example: a command that uses an entry.
    """
    if as_json:
        print_json(
            [{"name": e.name, "what": e.what, "keys": list(e.keys), **e.facts} for e in entries]
        )
        return
    known = {key["key"] for key in common_keys}
    keys = [key for one in entries for key in one.keys]
    widest = max((len(key["key"]) for key in keys), default=0)
    if keys:
        _print("Below each: KEY, what it is if left out, and its unit and meaning.\n")
    for one in entries:
        out.print(f"{one.name}: {one.what}", style="bold", soft_wrap=True)
        for line in one.lines:
            _print(f"    {line}")
        _print_keys([key for key in one.keys if key["key"] not in known], widest)
    if common_keys:
        _print("\nMost of them also have:")
        _print_keys(common_keys, widest)
    _print(f"\nFor instance: {example}")


def _print_keys(keys: Sequence[Mapping[str, str]], widest: int) -> None:
    for key in keys:
        _print(f"    {key['key']:<{widest}}  {key['default']:<10}  {key['what']}")


def _print(line: str) -> None:
    out.print(line, soft_wrap=True)
