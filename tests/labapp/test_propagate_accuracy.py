"""`labapp accuracy propagate`, its peers, and the random problems that judge free space."""

from __future__ import annotations

import json
import re
import sys
from dataclasses import fields, replace
from itertools import islice
from types import ModuleType

import cv2
import numpy as np
import pytest
from figures.free_space_problems import Judge, outcome, problems
from judges.fields import (
    Cells,
    Gaussians,
    Points,
    Pulse,
    by_space,
    by_spectrum,
    panels,
)
from labapp_peers import free_space as propagate_peers
from labapp_peers.free_space import candidates as peer_candidates

from labapp.accuracy.propagate import Reference, asked_field, candidates
from labapp.accuracy.rows import Row, measure
from labapp.errors import UserError
from optics.accuracy import Budget
from optics.plane import Plane
from optics.progress import Progress
from optics.propagation.operator import METHODS

NAMES = ("hcipy", "deeplens", "torchoptics")


def some_points(depth: float = 0.0, distance: float = 2e-3) -> Points:
    rng = np.random.default_rng(1)
    y, x, z = rng.uniform(-8e-5, 8e-5, (3, 8))
    return Points(y, x, depth * z, distance, 600e-9)


PAIR = (Pulse(10e-6, 2e4, 1 / 40e-6**2 + 2e8j), Pulse(-5e-6, -1e4, 1 / 60e-6**2 - 1e8j))


def relative(value, truth) -> float:
    return float(np.linalg.norm(value - truth) / np.linalg.norm(truth))


@pytest.mark.parametrize(("depth", "distance"), [(0.0, 2e-3), (0.0, -3e-3), (2.0, 2e-3)])
def test_the_judges_two_integrals_agree(depth, distance):
    """Over plane waves, and over spherical ones."""
    points = some_points(depth, distance)
    assert relative(by_spectrum(*PAIR, points), by_space(*PAIR, points)) < 1e-12


@pytest.mark.parametrize("distance", [2e-3, -3e-3])
def test_the_judges_paraxial_gaussian_is_fresnels_integral(distance):
    points, scale = some_points(2.0, distance), None
    scale = points.wavelength * points.z[:, None]
    sums = []
    for pulse, where in zip(PAIR, (points.y, points.x), strict=True):
        half = 6 * pulse.width
        u, weight = panels(pulse.middle - half, pulse.middle + half, 400)
        kernel = np.exp(1j * np.pi * (where[:, None] - u) ** 2 / scale)
        sums.append(kernel @ (weight * pulse.at(u)))
    truth = points.turn * sums[0] * sums[1] / (1j * scale[:, 0])
    value = Gaussians(((1.0 + 0j, *PAIR),)).field(points, paraxial=True)
    assert relative(value, truth) < 1e-12


def test_the_judges_cells_are_one_in_both_models_far_away():
    rng = np.random.default_rng(2)
    plane = Plane((7, 5), (6e-6, 8e-6), (1e-5, 0.0))
    cells = Cells(plane, (6e-6, 7e-6), rng.normal(size=(7, 5)) + 1j * rng.normal(size=(7, 5)))
    points = Points(*rng.uniform(-2e-5, 2e-5, (2, 9)), np.zeros(9), -0.05, 500e-9)
    both = [cells.field(points, paraxial=paraxial) for paraxial in (False, True)]
    assert relative(both[1], both[0]) < 1e-5


def test_the_judges_cells_are_fine_enough_behind_a_single_one():
    """On the axis of a wide cell, whose only turn is that of its own edges."""
    plane, one = Plane((1, 1), (40e-6, 40e-6)), np.ones((1, 1), dtype=np.complex128)
    points = Points(*np.zeros((3, 1)), 1e-3, 500e-9)
    whole = Cells(plane, plane.pitch, one).field(points, paraxial=False)
    parts = Plane((8, 8), (5e-6, 5e-6), (2.5e-6, 2.5e-6))
    cut = Cells(parts, parts.pitch, np.ones((8, 8), dtype=np.complex128))
    assert relative(whole, cut.field(points, paraxial=False)) < 1e-9


def test_the_judge_finds_an_error_as_large_as_it_is():
    problem = next(p for p in problems(7, 80) if p.paraxial and isinstance(p.light, Gaussians))
    answer = np.asarray(problem.operator(1e-6)(problem.field).resolve_conj())
    judge = Judge(problem, answer)
    assert judge.error(answer) < 1e-6
    assert judge.error(1.01 * answer) == pytest.approx(0.01, rel=1e-3)
    assert judge.error(answer * np.nan) != judge.error(answer)


def test_random_problems_keep_their_tolerance():
    found = [outcome(one, Budget(), 2e6) for one in islice(problems(21, 100), 12)]
    kinds = [one.kind for one in found]
    assert not {"wrong", "unreal"} & set(kinds), found
    assert kinds.count("kept") >= 8


def test_a_dark_window_is_refused_and_the_judge_agrees():
    """A beam that passes a millimetre beside the window: a share of 1e-30 is no light."""
    beam = Pulse(0.0, 0.0, 1 / 50e-6**2 + 0j)
    problem = replace(
        next(p for p in problems(7, 80) if not any(p.tilt)),
        source=Plane((120, 120), (5e-6, 5e-6)),
        light=Gaussians(((1.0 + 0j, beam, beam),)),
        target=Plane((20, 20), (5e-6, 5e-6), (1e-3, 0.0)),
        distance=0.02,
        wavelength=500e-9,
        carrier=(0.0, 0.0),
        band=None,
        tol=1e-3,
    )
    for paraxial in (False, True):
        found = outcome(replace(problem, paraxial=paraxial), Budget())
        assert found.kind == "refused", found


def test_random_problems_are_the_same_again_and_of_every_kind():
    first, second = (list(islice(problems(3), 60)) for _ in range(2))
    assert [p.distance for p in first] == [p.distance for p in second]
    assert {p.paraxial for p in first} == {False, True}
    assert {type(p.light) for p in first} == {Cells, Gaussians}
    assert any(p.distance < 0 for p in first)
    assert any(any(p.tilt) for p in first)
    assert any(any(p.carrier) for p in first)
    assert any(p.source == p.target for p in first)


def test_a_refusal_of_what_can_be_had_is_found(monkeypatch):
    """An engine that refuses without need: its own methods, asked by name, show it."""
    problem = next(p for p in problems(7, 80) if p.paraxial and not any(p.tilt))
    problem = replace(problem, tol=1e-3)
    honest = type(problem).operator

    def refusing(self, tol=None, **settings):
        if "method" not in settings:
            from optics.accuracy import ToleranceError

            raise ToleranceError("tol can't be kept")
        return honest(self, tol, **settings)

    monkeypatch.setattr(type(problem), "operator", refusing)
    assert outcome(problem, Budget()).kind == "unreal"


def small_case(*, light: str = "smooth", paraxial: bool = False, **changes):
    plane = Plane((180, 180), (8e-6, 8e-6))
    return asked_field(light, plane, changes.get("target", plane), 0.02, 550e-9, paraxial=paraxial)


def test_the_diagram_of_a_way_through_free_space(labapp, tmp_path, monkeypatch):
    monkeypatch.setattr("labapp.accuracy.propagate.TOLERANCES", (1e-2, 1e-5, 1e-8))
    monkeypatch.setattr("labapp.accuracy.rows._REPEATS", 1)
    files = ["--json", tmp_path / "rows.json", "--plot", tmp_path / "front.png"]
    asked = ["--size", "180", "--distance", "0.02", "--target-size", "40", "--target-pitch-um", "5"]
    code, printed, _ = labapp("accuracy", "propagate", *asked, *files)
    assert code == 0
    assert "front" in printed
    rows = json.loads((tmp_path / "rows.json").read_text())["rows"]
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
    monkeypatch.setattr("labapp.accuracy.rows._REPEATS", 1)
    case = small_case(light=light, paraxial=paraxial, target=Plane((20, 30), (8e-6, 8e-6)))
    reference = Reference(case)
    rows = measure(list(candidates(case, reference, Budget())), reference.truth, Progress()).rows
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
    (tmp_path / "rows.json").write_text("precious")
    code, _, said = labapp("accuracy", "propagate", "--json", tmp_path / "rows.json")
    assert (code, "--force" in said) == (1, True)


@pytest.fixture
def no_peers(monkeypatch):
    for name in NAMES:
        monkeypatch.setitem(sys.modules, name, None)


def peer_rows(case, pattern: str = "") -> list[Row]:
    reference = Reference(case)
    found = [
        one for one in peer_candidates(case, reference.of) if re.match(pattern, one.row.method)
    ]
    return measure(found, reference.truth, Progress()).rows


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
    monkeypatch.setattr("labapp.accuracy.rows._REPEATS", 1)
    rows = peer_rows(small_case(paraxial=paraxial), "hcipy.*1x finer, 360")
    assert min(row.error_achieved for row in rows) < 1e-6


def test_what_can_not_be_asked_is_refused_in_python_as_well():
    plane = Plane((180, 180), (8e-6, 8e-6))
    with pytest.raises(UserError, match="distance"):
        asked_field("smooth", plane, plane, float("inf"), 550e-9, paraxial=False)
