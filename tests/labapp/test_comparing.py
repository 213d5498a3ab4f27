"""A stored front: what became slower or less accurate is named, and nothing else."""

from __future__ import annotations

import json
from dataclasses import asdict, replace

import pytest

from labapp.accuracy.regression_check import (
    read_stored,
    regression_messages,
    require_comparable_rows,
    slower_rows,
)
from labapp.accuracy.work_precision import Row
from labapp.common.errors import UserError

ROW = Row("psf", "case", "way", "float64", 1e-3, error_achieved=1e-4, cpu_s=0.010)


def stored(tmp_path, *rows: Row, calibration_s: float = 0.005):
    path = tmp_path / "front.json"
    found = {"calibration_s": calibration_s, "rows": [asdict(row) for row in rows]}
    path.write_text(json.dumps(found))
    return read_stored(str(path))


def test_nothing_is_said_of_a_point_that_stayed(tmp_path):
    before = stored(tmp_path, ROW)
    assert slower_rows([ROW], 0.005, before) == []
    assert regression_messages([ROW], 0.005, before) == []


@pytest.mark.parametrize(
    ("seconds", "calibration_s", "named"),
    [(0.0119, 0.005, False), (0.0121, 0.005, True), (0.02, 0.01, False), (0.01, 0.004, True)],
)
def test_time_counts_in_units_of_the_calibration_kernel(tmp_path, seconds, calibration_s, named):
    """A machine that is busy all over is no news; a method that is slower on it is."""
    now = replace(ROW, cpu_s=seconds)
    before = stored(tmp_path, ROW)
    assert bool(slower_rows([now], calibration_s, before)) == named
    assert bool(regression_messages([now], calibration_s, before)) == named


@pytest.mark.parametrize(("error", "named"), [(1.9e-4, False), (2.1e-4, True)])
def test_an_error_counts_from_twice_on(tmp_path, error, named):
    now = replace(ROW, error_achieved=error)
    assert bool(regression_messages([now], 0.005, stored(tmp_path, ROW))) == named


def test_rounding_errors_are_no_errors(tmp_path):
    before = replace(ROW, error_achieved=1e-15)
    now = replace(ROW, error_achieved=9e-14)
    assert regression_messages([now], 0.005, stored(tmp_path, before)) == []


def test_what_fails_now_is_named(tmp_path):
    now = replace(ROW, error_achieved=None, cpu_s=None, failure="no memory")
    (line,) = regression_messages([now], 0.005, stored(tmp_path, ROW))
    assert line == "way, float64, tol 1e-03: fails now: no memory"


def test_files_of_another_case_or_kind_are_refused(tmp_path):
    other = stored(tmp_path, replace(ROW, case="another"))
    with pytest.raises(UserError, match="has no row of this case; give the case's own options"):
        require_comparable_rows([ROW], other)
    (tmp_path / "front.json").write_text("[1, 2]")
    with pytest.raises(UserError, match="isn't what --json printed"):
        read_stored(str(tmp_path / "front.json"))
    with pytest.raises(UserError, match="cannot be read"):
        read_stored(str(tmp_path / "none.json"))


def test_the_bundled_front_is_that_of_the_default_case():
    bundled = read_stored("bundled")
    cases = {key[1] for key in bundled.rows}
    assert cases == {"100 mm f/5.6, 520 nm, object at 2 m, focus at infinity, 256² of 3.45 µm"}
    assert {key[2] for key in bundled.rows} >= {"along the radius", "2048² grid, gridded FFT"}


def test_a_front_is_compared_from_the_command_line(labapp, tmp_path, monkeypatch):
    monkeypatch.setattr("labapp.accuracy.psf._GRIDS", (64,))
    monkeypatch.setattr("labapp.accuracy.psf._TOLERANCES", (1e-1, 1e-2))
    monkeypatch.setattr("labapp.accuracy.work_precision._REPEATS", 1)
    monkeypatch.setattr("labapp.accuracy.work_precision._LEAST_S", 1e-3)
    front = tmp_path / "front.json"
    options = ["accuracy", "psf", "--size", "16", "--f-number", "32"]
    code, printed, _ = labapp(*options, "--json")
    assert code == 0
    found = json.loads(printed)
    for row in found["rows"]:
        row["cpu_s"] = row["cpu_s"] and 100 * row["cpu_s"]
        row["error_achieved"] = row["error_achieved"] and 1.5 * row["error_achieved"]
    front.write_text(json.dumps(found))
    code, said, _ = labapp(*options, "--compare", front)
    assert code == 0
    assert "points compared" in said
    assert "front" in said
    for row in found["rows"]:
        row["error_achieved"] = row["error_achieved"] and row["error_achieved"] / 1000
    front.write_text(json.dumps(found))
    code, said, _ = labapp(*options, "--compare", front)
    assert code == 1
    assert "times the error of before" in " ".join(said.split())
