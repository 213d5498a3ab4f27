"""Whether a calibration still holds for a bench, in words for the person who stands before it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from typing import Any

from drivers.interfaces import Identity
from labapp.files.bench_file import BenchFile
from labapp.files.calibration_file import CalibrationFile
from labapp.files.reading import FileModel

MAX_AGE_DAYS = 30

_REMEDY = "Calibrate again: labapp calibrate"

_MAX_EXTRAPOLATION_NM = 15.0
"""By how much a response may be carried beyond the wavelengths at which it was measured."""

_DECISIVE_ROLES = ("slm", "camera")
"""Devices whose change ends a calibration; filters and targets don't."""


def calibration_summary(calibration: CalibrationFile) -> str:
    """One line: what is in force."""
    found = []
    if calibration.responses:
        listed = ", ".join(f"{w * 1e9:g}" for w in calibration.wavelengths)
        found.append(f"response at {listed} nm")
    found += ["registration"] if calibration.registrations else []
    found += ["wavefront"] if calibration.wavefront else []
    found += ["zeroth order"] if calibration.zeroth else []
    return (
        f"calibration of {calibration.date:%Y-%m-%d %H:%M} in force "
        f"({', '.join(found) or 'nothing'}; record {calibration.record})"
    )


def validity_warnings(
    calibration: CalibrationFile,
    bench: BenchFile,
    identities: Mapping[str, Identity],
    now: datetime | None = None,
) -> list[str]:
    """Why a calibration may not hold on a bench any more, each with what to do about it."""
    now = now or datetime.now(UTC)
    found = []
    days = (now - calibration.date).days
    if days > MAX_AGE_DAYS:
        found.append(
            f"the calibration is {days} days old, and {MAX_AGE_DAYS} are trusted. {_REMEDY}"
        )
    for role in _DECISIVE_ROLES:
        found += _device_warnings(calibration, role, identities)
    described = bench.model_dump(mode="json")
    for part in ("panel", "lens", "sensor", "polarisation"):
        then = getattr(calibration, part) or {}
        since = _keys_at_default(getattr(bench, part)) - then.keys()
        today = {key: value for key, value in (described[part] or {}).items() if key not in since}
        found += _settings_warnings(part, then, today)
    return found


def _keys_at_default(table: FileModel | None) -> set[str]:
    """A table's keys with their defaults: a calibration older than such a key says the same."""
    fields = type(table).model_fields.items() if table else ()
    return {
        key
        for key, field in fields
        if not field.is_required() and getattr(table, key) == field.default
    }


def wavelength_warnings(calibration: CalibrationFile, wavelengths: Iterable[float]) -> list[str]:
    """The same of wavelengths in metres that are about to be used."""
    known = calibration.wavelengths
    if not known:
        return []
    low, high = known[0] * 1e9 - _MAX_EXTRAPOLATION_NM, known[-1] * 1e9 + _MAX_EXTRAPOLATION_NM
    beyond = sorted({w * 1e9 for w in wavelengths if not low <= w * 1e9 <= high})
    if not beyond:
        return []
    listed = ", ".join(f"{nm:g}" for nm in beyond)
    measured = ", ".join(f"{w * 1e9:g}" for w in known)
    return [
        f"the response was calibrated at {measured} nm, and {listed} nm is used: the panel's "
        f"table carries it there, unmeasured. {_REMEDY} --wavelength-nm {listed.split(',')[0]}"
    ]


def _device_warnings(
    calibration: CalibrationFile, role: str, identities: Mapping[str, Identity]
) -> list[str]:
    then, now = calibration.devices.get(role), identities.get(role)
    if then is None or now is None:
        return []
    if (then.model, then.serial, then.simulated) == (now.model, now.serial, now.simulated):
        return []
    return [
        f"the calibration was made with the {role} {_device_name(then.model, then.serial)}, and "
        f"this is {_device_name(now.model, now.serial)}. {_REMEDY}"
    ]


def _device_name(model: str, serial: str) -> str:
    return f"{model} {serial}".strip()


def _settings_warnings(part: str, then: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    changed = [key for key in sorted({*then, *now}) if then.get(key) != now.get(key)]
    if not changed:
        return []
    listed = "; ".join(
        f"{key} was {_short(then.get(key))} and is {_short(now.get(key))}" for key in changed[:3]
    )
    more = f" (and {len(changed) - 3} more)" if len(changed) > 3 else ""
    return [f"the bench file's {part} has changed since the calibration: {listed}{more}. {_REMEDY}"]


def _short(value: Any) -> str:
    text = str(value)
    return text if len(text) <= 30 else f"{text[:27]}..."
