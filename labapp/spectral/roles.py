"""Which targets and patterns are the photograph, star, code and white of a snapshot."""

from __future__ import annotations

from labapp.common.errors import UserError
from labapp.files.plan_file import Reconstruction
from labapp.pictures.analysis.brackets import dark_target
from labapp.runs.record.reader import Record

FLAT = "flat"
"""Target that is taken for a white sheet if a record has it: plans call it so."""


def choose_roles(
    record: Record, target: str | None, pattern: str | None, star: str | None
) -> Reconstruction:
    """Choose a record's photograph, coded pattern and star, without a wavelength.

    What isn't named is taken from the plan's table [reconstruct], or else is the last target that
    is neither dark, star nor flat, and the last pattern that isn't neutral. Raises UserError if the
    record has no such target or pattern.

    target, pattern, star: names that the user chose.
    """
    plan = record.plan.reconstruct
    neutral = plan.neutral if plan else "neutral"
    named = star or (plan.star if plan else "star")
    star = _require_name("--star", named, record.target_names, star)
    photograph = target or (plan.photograph if plan else None) or _last_target(record, star)
    photograph = _require_name("--target", photograph, record.target_names, photograph)
    coded = pattern or (plan.coded if plan else None) or _last_pattern(record, neutral)
    coded = _require_name("--pattern", coded, record.pattern_names, coded)
    base = plan or Reconstruction(coded=coded)
    chosen = {"photograph": photograph, "coded": coded, "star": star, "neutral": neutral}
    return base.model_copy(update={**chosen, "wavelength_nm": None, "grey": True})


def white_target(record: Record, roles: Reconstruction, named: str | None) -> str:
    """Return the target that is white: the named one, a white sheet, or the star.

    Raises UserError if the record has no target of that name.
    """
    if named is not None:
        return _require_name("--white", named, record.target_names, named)
    return FLAT if FLAT in record.target_names else roles.star


def _require_name(option: str, name: str, names: list[str], required: str | None) -> str:
    """Return a name; raise UserError if a required one isn't in the record."""
    if required is not None and name not in names:
        raise UserError(f"{option} {name}: the record has {', '.join(names)}. Name one of these.")
    return name


def _last_target(record: Record, star: str) -> str:
    """Return the last target that is a photograph; raise UserError if there is none."""
    others = {dark_target(record.plan), star, FLAT}
    found = [one for one in record.target_names if one not in others]
    if not found:
        raise UserError(
            f"{record.path}: has the targets {', '.join(record.target_names)}, and no photograph. "
            "Name the target that is one: --target NAME."
        )
    return found[-1]


def _last_pattern(record: Record, neutral: str) -> str:
    """Return the last pattern that isn't neutral; raise UserError if there is none."""
    found = [one for one in record.pattern_names if one != neutral]
    if not found:
        raise UserError(
            f"{record.path}: has the patterns {', '.join(record.pattern_names)}, and no coded one. "
            "Name the coded pattern: --pattern NAME."
        )
    return found[-1]
