"""`labapp study list`: the studies, and what can be set."""

from __future__ import annotations

from labapp.common.listing import Listed, print_list
from labapp.files.keys import described_keys
from labapp.studies import STUDIES
from labapp.studies.finding import find_study


def list_studies(*, as_json: bool) -> None:
    """Print the studies with their settings, defaults and units."""
    example = "labapp study refocus --out refocus"
    print_list([_listed(name) for name in STUDIES], as_json=as_json, example=example)


def _listed(name: str) -> Listed:
    found = find_study(name)
    facts = {"source": found.source, "shows": found.shows, "method": found.method}
    what, keys = f"{found.title} ({found.source})", described_keys(found.settings)
    return Listed(name, what, keys, [found.method], {"title": found.title, **facts})
