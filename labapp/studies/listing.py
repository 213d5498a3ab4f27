"""`labapp study list`: the studies, and what can be set."""

from __future__ import annotations

from typing import Any

from labapp.common.console import out, print_json
from labapp.files.keys import described_keys
from labapp.studies import STUDIES
from labapp.studies.finding import find_study


def list_studies(*, as_json: bool) -> None:
    """Print the studies with their settings, defaults and units."""
    described = [_described(name) for name in STUDIES]
    if as_json:
        print_json(described)
        return
    for one in described:
        out.print(f"{one['name']}: {one['title']} ({one['source']})", style="bold", markup=False)
        out.print(f"    {one['method']}", markup=False, soft_wrap=True)
        for key in one["settings"]:
            line = f"    {key['key']:<16}  {key['default']:<10}  {key['what']}"
            out.print(line, markup=False, soft_wrap=True)
        out.print()
    out.print("For instance: labapp study refocus --out refocus")


def _described(name: str) -> dict[str, Any]:
    found = find_study(name)
    return {
        "name": name,
        "title": found.title,
        "source": found.source,
        "shows": found.shows,
        "method": found.method,
        "settings": described_keys(found.settings),
    }
