"""`labapp accuracy`: what is said about error and time is what was measured."""

from __future__ import annotations

import json
import math
from dataclasses import fields

import cv2
import numpy as np
import pytest

from labapp.accuracy.psf import _METHODS
from labapp.accuracy.row_output import print_data
from labapp.accuracy.work_precision import (
    Candidate,
    PlannedCall,
    Row,
    mark_front,
    measure,
)
from optics.accuracy import Account, ErrorEstimate
from optics.progress import Cancelled, Progress


def row(name: str, **values) -> Row:
    return Row("test", "case", name, "float64", None, **values)


def test_the_front_has_what_nothing_beats_in_both_time_and_error():
    rows = mark_front(
        [
            row("fast", error_achieved=1e-1, cpu_s=1.0),
            row("exact", error_achieved=1e-9, cpu_s=9.0),
            row("beaten", error_achieved=1e-1, cpu_s=10.0),
            row("middle", error_achieved=1e-3, cpu_s=3.0),
            row("failed", failure="no"),
        ]
    )
    assert [r.method for r in rows if r.on_front] == ["fast", "exact", "middle"]


def test_errors_are_measured_and_failures_are_rows():
    truth = np.array([3.0, 4.0])

    def refuse():
        raise ValueError("no such thing")

    def account():
        none = ErrorEstimate(0.0, "measured")
        return Account(
            "a way", "", "float32", 0.1, none, ErrorEstimate(0.02, "bound"), none, 3.0, 16,
            planning_predicted=2.0,
        )  # fmt: skip

    rows = measure(
        [
            Candidate(row("off"), lambda: PlannedCall(lambda: 1.01 * truth, 16, account)),
            Candidate(row("none"), refuse),
        ],
        truth,
        Progress(),
    ).rows
    assert rows[0].error_achieved == pytest.approx(0.01)
    assert (rows[0].error_predicted, rows[0].peak_bytes, rows[0].on_front) == (0.02, 16, True)
    assert rows[0].cpu_s > 0
    assert rows[0].first_answer_s >= 0
    assert (rows[0].cpu_predicted_s, rows[0].first_answer_predicted_s) == (3.0, 5.0)
    assert (rows[0].engine, rows[0].precision) == ("a way", "float32")
    assert (rows[1].failure, rows[1].on_front) == ("no such thing", False)


def test_measuring_can_be_cancelled():
    progress = Progress()
    progress.cancel()
    with pytest.raises(Cancelled):
        measure([Candidate(row("any"), lambda: PlannedCall(lambda: 1.0, 0))], np.ones(1), progress)


def test_the_diagram_of_a_psf(labapp, tmp_path, monkeypatch):
    monkeypatch.setattr("labapp.accuracy.psf._GRIDS", (64, 128, 256))
    tolerances = tuple(10.0**-k for k in (1, 1.5, 2, 2.5, 3, 4, 5, 8))
    monkeypatch.setattr("labapp.accuracy.psf._TOLERANCES", tolerances)
    monkeypatch.setattr("labapp.accuracy.work_precision._REPEATS", 1)
    monkeypatch.setattr("labapp.accuracy.work_precision._LEAST_S", 1e-3)
    files = ["--json", "--plot", tmp_path / "front.png"]
    code, printed, _ = labapp("accuracy", "psf", "--size", "16", "--f-number", "32", *files)
    assert code == 0
    rows = json.loads(printed)["rows"]
    assert set(rows[0]) == {field.name for field in fields(Row)}
    asked = [r for r in rows if r["tol"] is not None]
    assert {one["method"] for one in asked} == {*_METHODS.values()}
    asked = [one for one in asked if not one["failure"]]
    assert len(asked) >= 20
    for one in asked:
        assert one["error_achieved"] <= one["tol"]
        assert one["error_achieved"] <= 2 * one["error_predicted"]
    errors = [r["error_achieved"] for r in rows if "matrix" in r["method"]]
    # A staircase's error falls as its steps get smaller, and is no match for the integral.
    assert errors[0] > 5 * errors[-1] > 5 * asked[-1]["error_achieved"]
    assert cv2.imread(str(tmp_path / "front.png")).std() > 5


def test_existing_files_are_kept(labapp, tmp_path):
    (tmp_path / "front.png").write_text("precious")
    code, _, said = labapp("accuracy", "psf", "--plot", tmp_path / "front.png")
    assert (code, "--force" in said) == (1, True)


def test_an_error_without_a_number_is_null_and_the_other_rows_are_printed(capsys):
    rows = [Row("psf", "a lens", name, "double", 1e-3, error) for name, error in
            (("lost", math.inf), ("empty", math.nan), ("good", 1e-4))]  # fmt: skip
    print_data(rows)
    found = json.loads(capsys.readouterr().out)["rows"]
    assert [row["error_achieved"] for row in found] == [None, None, 1e-4]
