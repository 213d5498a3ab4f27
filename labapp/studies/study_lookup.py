"""Look up studies by name, and read their settings from the command line or from a record."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any

from labapp.common.errors import UserError
from labapp.common.plain_text import shell_word
from labapp.files.key_values import parse_key_values
from labapp.files.plain_data import parse_json
from labapp.files.plan_file import PlanFile
from labapp.files.reading import validate
from labapp.studies import STUDIES, catalogue
from labapp.studies.contract import Study, StudySettings

if TYPE_CHECKING:
    from labapp.runs.record.reader import Record


from labapp.common.list_output import ListEntry, print_list
from labapp.files.key_values import describe_keys

_NAME_KEY, _SETTINGS_KEY = "study", "study_settings"
"""Keys of the plan's metadata, by which a record names its study and the study's settings."""


def find_study(name: str) -> Study[Any]:
    """Return a study by its name. Raises UserError, which lists the names, if it isn't known."""
    if name not in STUDIES:
        raise UserError(
            f"study {name!r} is not known. Choose one of {', '.join(STUDIES)}; "
            "labapp study list tells what they are."
        )
    study: Study[Any] = import_module(f"{catalogue.__name__}.{STUDIES[name].module}").STUDY
    return study


def read_study_settings(name: str, keys: Sequence[str], *, quick: bool) -> StudySettings:
    """Read settings from KEY=VALUE; UserError names the key, the value and a remedy."""
    model: type[StudySettings] = find_study(name).settings
    base = dict(model.QUICK) if quick else {}
    return validate(base | parse_key_values(keys, model), model, f"study {name}")


def with_study_metadata(plan: PlanFile, name: str, settings: StudySettings, seed: int) -> PlanFile:
    """Add name and settings to a plan, so that its record can be evaluated again."""
    mine = {_NAME_KEY: name, _SETTINGS_KEY: settings.model_dump_json()}
    return plan.model_copy(update={"seed": seed, "metadata": plan.metadata | mine})


def settings_from_record(record: Record, name: str) -> StudySettings:
    """Read settings from a record. Raises UserError if it is of no or another study."""
    metadata = record.plan.metadata
    if metadata.get(_NAME_KEY) != name:
        known = metadata.get(_NAME_KEY)
        remedy = (
            f"Evaluate it with: labapp study {shell_word(known)}" if known else "See: labapp report"
        )
        raise UserError(f"{record.path}: is no record of the study {name!r}. {remedy}.")
    source = f"{record.path}: settings"
    data = parse_json(str(metadata.get(_SETTINGS_KEY, "{}")), source)
    return validate(data, find_study(name).settings, source)


def list_studies(*, as_json: bool) -> None:
    """Print the names of all studies with their settings, defaults and units."""
    entries = []
    for name in STUDIES:
        found = find_study(name)
        facts = {"source": found.source, "shows": found.shows, "method": found.method}
        what, keys = f"{found.title} ({found.source})", describe_keys(found.settings)
        facts = {"title": found.title, **facts}
        entries.append(ListEntry(name, what, keys, [found.method], facts))
    print_list(entries, as_json=as_json, example="labapp study refocus --out refocus")
