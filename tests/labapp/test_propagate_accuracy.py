"""`labapp accuracy propagate`, its peers, and the random problems that judge free space."""

from __future__ import annotations

import json
import re
import sys
from dataclasses import fields
from types import ModuleType

import cv2
import numpy as np
import pytest
from labapp_peers import free_space as propagate_peers
from labapp_peers.free_space import candidates as peer_candidates

from labapp.accuracy.propagate import FieldReference, candidates, field_case_from_options
from labapp.accuracy.work_precision import Row, measure
from labapp.common.errors import UserError
from optics.accuracy import Budget
from optics.plane import Plane
from optics.progress import Progress
from optics.propagation.free_space_operator import METHODS

pytestmark = pytest.mark.usefixtures("few_field_samples")

NAMES = ("hcipy", "deeplens", "torchoptics")


def small_case(*, light: str = "smooth", paraxial: bool = False, **changes):
    plane = Plane((180, 180), (8e-6, 8e-6))
    return field_case_from_options(
        light, plane, changes.get("target", plane), 0.02, 550e-9, paraxial=paraxial
    )


def test_the_diagram_of_a_way_through_free_space(labapp, tmp_path, monkeypatch):
    monkeypatch.setattr("labapp.accuracy.propagate.TOLERANCES", (1e-2, 1e-5, 1e-8))
    monkeypatch.setattr("labapp.accuracy.work_precision._REPEATS", 1)
    monkeypatch.setattr("labapp.accuracy.work_precision._LEAST_S", 1e-3)
    files = ["--json", "--plot", tmp_path / "front.png"]
    asked = ["--size", "180", "--distance", "0.02", "--target-size", "40", "--target-pitch-um", "5"]
    code, printed, _ = labapp("accuracy", "propagate", *asked, *files)
    assert code == 0
    rows = json.loads(printed)["rows"]
    assert set(rows[0]) == {field.name for field in fields(Row)}
    assert {row["method"] for row in rows} == set(METHODS)
    good = [row for row in rows if not row["failure"]]
    assert len(good) >= 3
    for row in good:
        assert row["error_achieved"] <= row["tol"]
        assert row["error_achieved"] <= 2 * row["error_predicted"]
    assert any("paraxial" in row["failure"] for row in rows)
    assert cv2.imread(str(tmp_path / "front.png")).std() > 5


@pytest.mark.parametrize("light", ["smooth", "cells"])
@pytest.mark.parametrize("paraxial", [False, True])
def test_every_kind_of_field_is_measured(monkeypatch, light, paraxial):
    monkeypatch.setattr("labapp.accuracy.propagate.TOLERANCES", (1e-4,))
    monkeypatch.setattr("labapp.accuracy.work_precision._REPEATS", 1)
    monkeypatch.setattr("labapp.accuracy.work_precision._LEAST_S", 1e-3)
    case = small_case(light=light, paraxial=paraxial, target=Plane((20, 30), (8e-6, 8e-6)))
    reference = FieldReference(case)
    rows = measure(
        list(candidates(case, reference, Budget())), reference.exact_samples, Progress()
    ).rows
    good = [row for row in rows if not row.failure]
    assert good
    assert max(row.error_achieved for row in good) <= 1e-4
    assert ("Fresnel" in case.name) == paraxial


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--light", "laser"], "--light laser"),
        (["--distance", "0"], "--distance"),
        (["--distance", "nan"], "--distance"),
        (["--wavelength-nm", "-1"], "--wavelength-nm"),
        (["--pitch-um", "0"], "--pitch-um"),
        (["--target-pitch-um", "-2"], "--target-pitch-um"),
        (["--target-size", "0"], "--size 0"),
        (["--size", "20"], "--size 20: a smooth field takes"),
        (["--centre", "here"], "--centre here"),
    ],
)
def test_bad_questions_are_refused_by_name(labapp, words, said):
    code, _, complaint = labapp("accuracy", "propagate", *words)
    assert code == 1
    assert said in complaint


def test_existing_files_are_kept(labapp, tmp_path):
    (tmp_path / "front.png").write_text("precious")
    code, _, said = labapp("accuracy", "propagate", "--plot", tmp_path / "front.png")
    assert (code, "--force" in said) == (1, True)


@pytest.fixture
def no_peers(monkeypatch):
    for name in NAMES:
        monkeypatch.setitem(sys.modules, name, None)


def peer_rows(case, pattern: str = "") -> list[Row]:
    reference = FieldReference(case)
    found = [
        one
        for one in peer_candidates(case, reference.samples_of)
        if re.match(pattern, one.row.method)
    ]
    return measure(found, reference.exact_samples, Progress()).rows


@pytest.mark.usefixtures("no_peers")
def test_a_library_that_is_missing_is_one_row_that_says_so():
    rows = peer_rows(small_case())
    assert [row.method for row in rows] == list(NAMES)
    assert all("isn't installed" in row.failure and not row.on_front for row in rows)


@pytest.mark.usefixtures("no_peers")
def test_peers_are_not_asked_for_cells():
    rows = peer_rows(small_case(light="cells"))
    assert all("smooth fields" in row.failure for row in rows)


@pytest.mark.usefixtures("no_peers")
@pytest.mark.parametrize(
    ("given", "said"),
    [
        (np.ones((3, 3), dtype=complex), "(3, 3)"),
        (np.full((180, 180), np.nan + 0j), "finite"),
        (None, "AttributeError"),
    ],
)
def test_an_answer_that_is_none_is_a_row_in_words(monkeypatch, given, said):
    library = ModuleType("hcipy")
    vars(library).update(__version__="9.9")
    monkeypatch.setitem(sys.modules, "hcipy", library)
    way = propagate_peers._Way(
        "a way", lambda *_: lambda: given, pads=(1,), precisions=("float64",)
    )
    monkeypatch.setattr(propagate_peers, "_ways", lambda _: {"hcipy": [way]})
    (row,) = peer_rows(small_case())
    assert row.failure.startswith("hcipy 9.9")
    assert said in row.failure


@pytest.mark.usefixtures("no_peers")
def test_a_library_for_one_plane_is_not_asked_for_another(monkeypatch):
    library = ModuleType("hcipy")
    vars(library).update(__version__="9.9")
    monkeypatch.setitem(sys.modules, "hcipy", library)
    rows = peer_rows(small_case(target=Plane((20, 20), (4e-6, 4e-6))), "hcipy")
    assert all("own samples only" in row.failure for row in rows)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("paraxial", [False, True])
def test_hcipy_reaches_the_exact_field_where_it_is_installed(monkeypatch, paraxial):
    pytest.importorskip("hcipy", exc_type=ImportError)
    monkeypatch.setattr("labapp.accuracy.work_precision._REPEATS", 1)
    monkeypatch.setattr("labapp.accuracy.work_precision._LEAST_S", 1e-3)
    rows = peer_rows(small_case(paraxial=paraxial), "hcipy.*1x finer, 360")
    assert min(row.error_achieved for row in rows) < 1e-6


def test_what_can_not_be_asked_is_refused_in_python_as_well():
    plane = Plane((180, 180), (8e-6, 8e-6))
    with pytest.raises(UserError, match="distance"):
        field_case_from_options("smooth", plane, plane, float("inf"), 550e-9, paraxial=False)
