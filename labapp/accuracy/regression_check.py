"""Whether a method has become slower or less accurate than it was."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from labapp.accuracy.work_precision import Row
from labapp.common.errors import UserError

SLOWER, LESS_ACCURATE = 1.2, 2.0

_ROUNDING_ERROR = 3e-13
"""Errors below this are rounding, which differs from machine to machine."""

_Key = tuple[str, str, str, str, float | None]


@dataclass(frozen=True)
class StoredRows:
    """Rows of an earlier run, and its calibration kernel's processor time in seconds."""

    rows: dict[_Key, dict[str, Any]]
    calibration_s: float
    source: str


def read_stored(name: str) -> StoredRows:
    """From a file of what `--json` printed, or "bundled"; UserError for anything else."""
    if name == "bundled":
        text = resources.files("labapp.data").joinpath("psf_front.json").read_text()
    else:
        try:
            text = Path(name).read_text()
        except OSError as error:
            raise UserError(f"{name}: cannot be read: {error.strerror}.") from error
    try:
        found = json.loads(text)
        rows = {_key(row): row for row in found["rows"]}
        return StoredRows(rows, float(found["calibration_s"]), name)
    except (ValueError, KeyError, TypeError) as error:
        raise UserError(f"{name}: isn't what --json printed.") from error


def _key(row: dict[str, Any]) -> _Key:
    return row["operation"], row["case"], row["method"], row["precision"], row["tol"]


def slower_rows(rows: Sequence[Row], calibration_s: float, stored: StoredRows) -> list[int]:
    """Which rows take more of the calibration kernel's time than they did, and how they did."""
    return [
        number for number, row in enumerate(rows) if _slowdown(row, calibration_s, stored) > SLOWER
    ]


def _slowdown(row: Row, calibration_s: float, stored: StoredRows) -> float:
    before = stored.rows.get(_key(vars(row)), {}).get("cpu_s")
    if row.cpu_s is None or not before:
        return 0.0
    return (row.cpu_s / calibration_s) / (before / stored.calibration_s)


def regression_messages(rows: Sequence[Row], calibration_s: float, stored: StoredRows) -> list[str]:
    """A line for each row that became slower, less accurate, or failed where it didn't."""
    lines = []
    for row in rows:
        before = stored.rows.get(_key(vars(row)))
        if before is None:
            continue
        what = f"{row.method}, {row.precision}" + (f", tol {row.tol:.0e}" if row.tol else "")
        ratio = _slowdown(row, calibration_s, stored)
        if row.failure and not before["failure"]:
            lines.append(f"{what}: fails now: {row.failure}")
        if ratio > SLOWER:
            lines.append(f"{what}: {ratio:.2f} times as long as before")
        worse = (row.error_achieved or 0) / max(before["error_achieved"] or 0, _ROUNDING_ERROR)
        if worse > LESS_ACCURATE:
            lines.append(f"{what}: {worse:.1f} times the error of before")
    return lines


def require_comparable_rows(rows: Sequence[Row], stored: StoredRows) -> int:
    """How many rows can be compared; UserError if none can."""
    count = sum(_key(vars(row)) in stored.rows for row in rows)
    if not count:
        raise UserError(f"{stored.source}: has no row of this case; give the case's own options.")
    return count
