"""`labapp accuracy hdr`: rows of merges by exposures and method."""

from __future__ import annotations

import json

import numpy as np
import pytest

from labapp.accuracy.hdr import measure_merges
from labapp.accuracy.hdr_case import BracketCase
from labapp.accuracy.hdr_diagram import draw_merges
from labapp.accuracy.work_precision import CUT, Deadline
from optics.hdr import METHODS
from optics.progress import Progress


@pytest.fixture(autouse=True)
def once(monkeypatch):
    monkeypatch.setattr("labapp.accuracy.hdr._SHORT_S", 0.0)


def test_every_method_is_a_row_and_more_exposures_err_less(labapp):
    code, printed, errors = labapp("accuracy", "hdr", "--frames", "2,8", "--pixels", 400, "--json")
    assert code == 0, errors
    rows = json.loads(printed)["rows"]
    names = {*METHODS, "OpenCV Debevec", "OpenCV Robertson"}
    assert {(row["method"], row["frames"]) for row in rows} == {
        (name, count) for name in names for count in (2, 8)
    }
    few, many = ({row["method"]: row for row in rows if row["frames"] == count} for count in (2, 8))
    for method in METHODS:
        assert many[method]["error_achieved"] < few[method]["error_achieved"]
        assert many[method]["exposure_s"] == pytest.approx(1e-3 * (4**8 - 1) / 3)
        # What a method states is what it reaches.
        assert many[method]["error_predicted"] == pytest.approx(
            many[method]["error_achieved"], rel=0.05
        )
    assert many["full"]["efficiency"] > 0.95
    assert many["full"]["bias"] < many["Granados"]["bias"]
    assert many["OpenCV Robertson"]["error_achieved"] > many["full"]["error_achieved"]


def test_the_least_error_is_that_of_photons_and_reading():
    case = BracketCase(1, 2.0, 1e-3, 2.0, 16, 12, 2.6, 2.4, 100, 0)
    light = case.rates * 1e-3
    floor = 2.4**2 + 2.6**2 / 12
    wanted = np.sqrt(light + floor * (1 + 1 / 16)) / light
    assert case.least_errors == pytest.approx(wanted, rel=1e-6)


def test_a_failure_and_what_is_cut_are_rows():
    case = BracketCase(1, 2.0, 1e-3, 4.0, 1, 12, 2.6, 2.4, 100, 0)
    failed = [row for row in measure_merges([case], Progress()) if row.failure]
    assert any("isn't finite" in row.failure for row in failed)
    rows = measure_merges([case], Progress(), Deadline(0.0))
    assert {row.failure for row in rows} == {CUT}


@pytest.mark.parametrize("wrong", ["", "0", "x", "2,,3", "2,17", "1.5"])
def test_wrong_numbers_of_exposures_are_refused(labapp, wrong):
    code, _, errors = labapp("accuracy", "hdr", "--frames", wrong)
    assert code == 1
    assert "give whole numbers from 1 to 16" in errors


def test_the_diagram_shows_errors_by_exposures_above_the_least_possible_ones():
    cases = [BracketCase(n, 4.0, 1e-3, 4.0, 16, 12, 2.6, 2.4, 500, 0) for n in (2, 4)]
    rows = measure_merges(cases, Progress())
    left, right = draw_merges("two cases", rows).axes
    lines = {one.get_label(): one for one in left.get_lines()}
    least = lines["least of any unbiased estimate"]
    assert list(least.get_xdata()) == [2, 4]
    # Few levels have large errors, each of 500 pixels: their mean is known to 1.5 %.
    for name in METHODS:
        assert (lines[name].get_ydata() > 0.95 * least.get_ydata()).all()
    wanted = [np.sqrt(np.mean(case.least_errors**2)) for case in cases]
    assert least.get_ydata() == pytest.approx(wanted)
    assert [one.get_text() for one in left.get_xticklabels()] == ["2\n0.005 s", "4\n0.085 s"]
    assert "processor time" in right.get_xlabel()


def test_the_diagram_is_written(labapp, tmp_path):
    plot = tmp_path / "hdr.png"
    code, printed, errors = labapp(
        "accuracy", "hdr", "--frames", 2, "--pixels", 100, "--plot", plot
    )
    assert code == 0, errors
    assert plot.stat().st_size > 10_000
    assert "2, 0.005 s" in printed
