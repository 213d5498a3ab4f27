"""Compares measured rows with stored ones: has a method become slower or less accurate?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from labapp.accuracy.work_precision import Row
from labapp.common.errors import UserError
from labapp.files.plain_data import MOST_JSON_BYTES, parse_json
from labapp.files.reading import bundled_path, read_text

SLOWER, LESS_ACCURATE = 1.2, 2.0
"""Factors of the stored time and of the stored error above which a row counts as worse."""

_Key = tuple[str, str, str, str, float | None]


@dataclass(frozen=True)
class StoredRows:
    """Rows of an earlier measurement, the seconds of its calibration kernel, and their file."""

    rows: dict[_Key, dict[str, Any]]
    calibration_s: float
    source: str


def read_stored(name: str) -> StoredRows:
    """Read rows from a file with the output of `--json`, or the "bundled" ones.

    Raises UserError for a file that can't be read or holds something else.
    """
    path = bundled_path("psf_front.json") if name == "bundled" else Path(name)
    found = parse_json(read_text(path, "what --json printed", MOST_JSON_BYTES), name)
    try:
        rows = {_key(row): row for row in found["rows"]}
        return StoredRows(rows, float(found["calibration_s"]), name)
    except (ValueError, KeyError, TypeError) as error:
        raise UserError(f"{name}: isn't what --json printed.") from error


def _key(row: dict[str, Any]) -> _Key:
    """Return what identifies a row among the stored ones.

    With a tolerance, the method itself chooses its precision.
    """
    precision = row["precision"] if row["tol"] is None else ""
    return row["operation"], row["case"], row["method"], precision, row["tol"]


def slower_rows(rows: Sequence[Row], calibration_s: float, stored: StoredRows) -> list[int]:
    """Return the indices of rows that became slower than the stored ones."""
    return [
        number for number, row in enumerate(rows) if _slowdown(row, calibration_s, stored) > SLOWER
    ]


def _slowdown(row: Row, calibration_s: float, stored: StoredRows) -> float:
    """Return a row's time over the stored one, both in calibration kernels; 0 without one."""
    before = stored.rows.get(_key(vars(row)), {}).get("cpu_s")
    if row.cpu_s is None or not before:
        return 0.0
    return (row.cpu_s / calibration_s) / (before / stored.calibration_s)


def regression_messages(rows: Sequence[Row], calibration_s: float, stored: StoredRows) -> list[str]:
    """Return a message for each way in which a row became slower, less accurate, or fails now."""
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
        # Errors below 3e-13 are rounding, which differs from machine to machine.
        worse = (row.error_achieved or 0) / max(before["error_achieved"] or 0, 3e-13)
        if worse > LESS_ACCURATE:
            lines.append(f"{what}: {worse:.1f} times the error of before")
    return lines


def require_comparable_rows(rows: Sequence[Row], stored: StoredRows) -> int:
    """Return how many rows have a stored one; raise UserError if there is none."""
    count = sum(_key(vars(row)) in stored.rows for row in rows)
    if not count:
        raise UserError(f"{stored.source}: has no row of this case; give the case's own options.")
    return count
