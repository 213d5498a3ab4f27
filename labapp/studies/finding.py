"""Studies by their names, and settings as a person gives them or a record keeps them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any

from labapp.common.errors import UserError
from labapp.files.keys import read_keys
from labapp.files.plan_file import PlanFile
from labapp.files.reading import validate
from labapp.studies import STUDIES, catalogue
from labapp.studies.contract import Settings, Study

if TYPE_CHECKING:
    from labapp.runs.record.reader import Record

_NAME, _SETTINGS = "study", "study_settings"
"""Keys of the plan's metadata, by which a record knows what it was taken for."""


def find_study(name: str) -> Study[Any]:
    """A study by its name; UserError lists the names."""
    if name not in STUDIES:
        raise UserError(
            f"study {name!r} is not known. Choose one of {', '.join(STUDIES)}; "
            "labapp study list tells what they are."
        )
    study: Study[Any] = import_module(f"{catalogue.__name__}.{STUDIES[name].module}").STUDY
    return study


def read_settings(name: str, keys: Sequence[str], *, quick: bool) -> Settings:
    """A study's settings from KEY=VALUE; UserError names key, value and remedy."""
    model: type[Settings] = find_study(name).settings
    base = dict(model.QUICK) if quick else {}
    return validate(base | read_keys(keys, model), model, f"study {name}")


def marked(plan: PlanFile, name: str, settings: Settings, seed: int) -> PlanFile:
    """The plan, which says what study it is for; its record can be evaluated again."""
    mine = {_NAME: name, _SETTINGS: settings.model_dump_json()}
    return plan.model_copy(update={"seed": seed, "metadata": plan.metadata | mine})


def settings_of(record: Record, name: str) -> Settings:
    """The settings that a record was taken with; UserError if it isn't one of the study."""
    metadata = record.plan.metadata
    if metadata.get(_NAME) != name:
        known = metadata.get(_NAME)
        remedy = f"Evaluate it with: labapp study {known}" if known else "See: labapp report"
        raise UserError(f"{record.path}: is no record of the study {name!r}. {remedy}.")
    data = json.loads(str(metadata.get(_SETTINGS, "{}")))
    return validate(data, find_study(name).settings, f"{record.path}: settings")
