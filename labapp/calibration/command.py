"""`labapp calibrate`: from a bench, or a record that is there already, to a calibration file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from labapp.bench.opening import BenchFiles, open_bench
from labapp.calibration.calibrating import (
    FILE,
    PICTURE,
    PLAN,
    RECORD,
    Calibrated,
    calibrate,
    conclude,
    prepare_only,
)
from labapp.calibration.request import Request
from labapp.calibration.telling import as_data, print_tables
from labapp.common.console import out, print_json, watched
from labapp.common.errors import UserError
from labapp.files.reading import explain
from labapp.files.writing import require_free
from labapp.runs.running import Manner, attended


@dataclass(frozen=True)
class Asked:
    """The command line's words. regions: as in "2x2". only: parts, or none for all."""

    wavelengths_nm: tuple[float, ...]
    regions: str
    only: tuple[str, ...]
    levels: int
    exposure_ms: float | None
    star: str
    dark: str
    star_um: float | None
    star_m: float | None

    def request(self) -> Request:
        """UserError names the option that is wrong."""
        rows, _, columns = self.regions.partition("x")
        if not (rows.isdigit() and columns.isdigit()):
            raise UserError(f"--regions {self.regions}: give rows x columns, as in 2x2.")
        data: dict[str, Any] = {
            "wavelengths_nm": sorted(set(self.wavelengths_nm)),
            "regions": (int(rows), int(columns)),
            "levels": self.levels,
            "exposure_ms": self.exposure_ms,
            "star": self.star,
            "dark": self.dark,
            "star_diameter_um": self.star_um,
            "star_distance_m": self.star_m,
        }
        if self.only:
            data["parts"] = self.only
        try:
            return Request.model_validate(data)
        except ValidationError as error:
            raise UserError(explain(error, "calibrate")) from error


def calibrate_bench(asked: Asked, folder: Path, files: BenchFiles, manner: Manner) -> None:
    """Calibrate, tell how it went, and where everything is."""
    request = asked.request()
    require_free(folder, (PLAN, RECORD, FILE, PICTURE), force=manner.force)
    with open_bench(files, speed=manner.speed) as bench, attended(manner) as (progress, ask):
        found = calibrate(bench, request, folder, force=manner.force, progress=progress, ask=ask)
    _tell(found, folder, manner.as_json)


def write_plan_only(asked: Asked, folder: Path, files: BenchFiles, manner: Manner) -> None:
    """Plan and patterns in a folder, for `labapp run`."""
    request = asked.request()
    require_free(folder, (PLAN,), force=manner.force)
    with open_bench(files) as bench:
        plan = prepare_only(bench, request, folder, force=manner.force)
    if manner.as_json:
        print_json({"plan": str(folder / PLAN), "patterns": len(plan.patterns)})
        return
    out.print(f"wrote {folder / PLAN} and {len(plan.patterns)} patterns. Then:")
    out.print(f"labapp run {folder / PLAN} --out {folder / RECORD}")
    out.print(f"labapp calibrate --fit {folder / RECORD}")


def fit_again(record: Path, manner: Manner) -> None:
    """Fit a record that is there already; the file and the picture go beside it."""
    require_free(record.parent, (FILE, PICTURE), force=manner.force)
    with watched() as progress:
        found = conclude(record, progress)
    _tell(found, record.parent, manner.as_json)


def _tell(found: Calibrated, folder: Path, as_json: bool) -> None:
    if as_json:
        print_json(as_data(found, folder))
    else:
        print_tables(found, folder)
