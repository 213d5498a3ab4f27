"""Warnings in words that a calibration, of all devices or of the camera, may no longer hold."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from typing import Any

from drivers.interfaces import Identity
from labapp.files.bench_file import BenchFile
from labapp.files.calibration_file import CalibrationFile, DeviceIdentityTable
from labapp.files.camera_noise_file import CameraNoiseFile

_MAX_AGE_DAYS, _MAX_CAMERA_AGE_DAYS = 30, 180
"""Ages beyond which a calibration, and one of the camera, gives a warning. Chosen."""

_MAX_EXTRAPOLATION_NM = 15.0
"""Distance by which the phase response may be extrapolated beyond its wavelengths. Chosen."""

_REMEDY = "Calibrate again: labapp calibrate"
_CAMERA_REMEDY = "Calibrate the camera again: labapp calibrate --camera"

_DECISIVE_ROLES = ("slm", "camera")
"""Devices whose replacement makes a calibration invalid; filters and targets may change."""


def calibration_summary(calibration: CalibrationFile) -> str:
    """Summarise in one line which calibration is in force."""
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
    """Return the reasons why a calibration in force may no longer hold, each with a remedy.

    bench: as described today.
    identities: of the open devices, by their names.
    now: time at which the age is judged; None for the present.
    """
    found = _age_warnings("the calibration", calibration.date, _MAX_AGE_DAYS, now, f". {_REMEDY}")
    for role in _DECISIVE_ROLES:
        device = calibration.devices.get(role)
        found += _device_warnings("the calibration", role, device, identities, _REMEDY)
    for part in ("panel", "lens", "sensor", "polarisation"):
        then = getattr(calibration, part) or {}
        found += _part_warnings(bench, part, then, _REMEDY)
    return found


def camera_calibration_summary(calibration: CameraNoiseFile) -> str:
    """Summarise in one line which calibration of the camera is in force."""
    gain, noise = calibration.gain_electrons_per_dn, calibration.read_noise_electrons
    return (
        f"camera calibration of {calibration.date:%Y-%m-%d %H:%M} in force ({gain.value:.4g} "
        f"electrons/DN, read noise {noise.value:.3g} electrons, "
        f"{len(calibration.defects.pixels)} defective pixels; record {calibration.record})"
    )


def camera_validity_warnings(
    calibration: CameraNoiseFile,
    bench: BenchFile,
    identities: Mapping[str, Identity],
    now: datetime | None = None,
) -> list[str]:
    """Return the reasons why a camera's calibration in force may no longer hold.

    Parameters are those of `validity_warnings`.
    """
    why = f": pixels become hot with time. {_CAMERA_REMEDY}"
    found = _age_warnings(
        "the camera calibration", calibration.date, _MAX_CAMERA_AGE_DAYS, now, why
    )
    found += _device_warnings(
        "the camera calibration", "camera", calibration.camera, identities, _CAMERA_REMEDY
    )
    found += _part_warnings(bench, "sensor", calibration.sensor, _CAMERA_REMEDY)
    options = bench.devices.camera.options
    return found + _settings_warnings("camera", calibration.options, options, _CAMERA_REMEDY)


def _age_warnings(
    what: str, date: datetime, trusted: int, now: datetime | None, ending: str
) -> list[str]:
    """Warn if a calibration, `what`, is more days old than are trusted."""
    days = ((now or datetime.now(UTC)) - date).days
    if days <= trusted:
        return []
    return [f"{what} is {days} days old, and {trusted} are trusted{ending}"]


def _part_warnings(bench: BenchFile, part: str, then: Mapping[str, Any], remedy: str) -> list[str]:
    """Warn if a table of the bench file has changed since a calibration."""
    table = getattr(bench, part)
    described = table.model_dump(mode="json") if table else {}
    fields = type(table).model_fields if table else {}

    def is_default(key: str) -> bool:
        return not fields[key].is_required() and getattr(table, key) == fields[key].default

    # A calibration from before a key existed means its default, so that it agrees.
    today = {key: value for key, value in described.items() if key in then or not is_default(key)}
    return _settings_warnings(part, then, today, remedy)


def wavelength_warnings(calibration: CalibrationFile, wavelengths: Iterable[float]) -> list[str]:
    """Warn if wavelengths in metres lie too far outside the calibrated ones."""
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
    what: str,
    role: str,
    then: DeviceIdentityTable | None,
    identities: Mapping[str, Identity],
    remedy: str,
) -> list[str]:
    """Warn if a device is another than that of a calibration, `what`."""
    now = identities.get(role)
    if then is None or now is None:
        return []
    if (then.model, then.serial, then.simulated) == (now.model, now.serial, now.simulated):
        return []
    before, today = (f"{one.model} {one.serial}".strip() for one in (then, now))
    return [f"{what} was made with the {role} {before}, and this is {today}. {remedy}"]


def _settings_warnings(
    part: str, then: Mapping[str, Any], now: Mapping[str, Any], remedy: str
) -> list[str]:
    changed = [key for key in sorted({*then, *now}) if then.get(key) != now.get(key)]
    if not changed:
        return []
    listed = "; ".join(
        f"{key} was {_short(then.get(key))} and is {_short(now.get(key))}" for key in changed[:3]
    )
    more = f" (and {len(changed) - 3} more)" if len(changed) > 3 else ""
    return [f"the bench file's {part} has changed since the calibration: {listed}{more}. {remedy}"]


def _short(value: Any) -> str:
    """Shorten a value to a text of 30 characters at most."""
    text = str(value)
    return text if len(text) <= 30 else f"{text[:27]}..."
