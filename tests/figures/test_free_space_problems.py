"""Random ways through free space: the judge finds errors, and tolerances are kept."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
from judges.fields import Cells, Gaussians, Pulse

from figures.free_space_problems import Judge, outcome, problems
from optics.accuracy import Budget
from optics.plane import Plane


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
