"""The command `labapp study list`: print the studies and their settings."""

from __future__ import annotations

from labapp.common.list_output import ListEntry, print_list
from labapp.files.key_values import describe_keys
from labapp.studies import STUDIES
from labapp.studies.study_lookup import find_study


def list_studies(*, as_json: bool) -> None:
    """Print the names of all studies with their settings, defaults and units."""
    example = "labapp study refocus --out refocus"
    print_list([_list_entry(name) for name in STUDIES], as_json=as_json, example=example)


def _list_entry(name: str) -> ListEntry:
    found = find_study(name)
    facts = {"source": found.source, "shows": found.shows, "method": found.method}
    what, keys = f"{found.title} ({found.source})", describe_keys(found.settings)
    return ListEntry(name, what, keys, [found.method], {"title": found.title, **facts})
