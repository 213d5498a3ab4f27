"""What the simulator decided, in a record: for each different picture, and without rendering it."""

from __future__ import annotations

import itertools
import json

import pytest
from small_bench.files import scene_text

import simulator.imaging
from labapp.bench.opening import open_bench
from labapp.common.errors import UserError
from labapp.files.plan_file import PlanFile
from labapp.files.reading import read_file
from labapp.patterns.grey_levels import compute_patterns
from labapp.runs.acquisition.feasibility import _DECISIONS
from labapp.runs.acquisition.record_contents import effect_plans
from labapp.runs.acquisition.runner import run_plan
from labapp.runs.capabilities import BenchCapabilities
from labapp.runs.record.reader import Record
from labapp.runs.record_summary import show_effects
from labapp.runs.steps import planned_shots
from optics.progress import Progress
from simulator.imaging import Imaging, picture_key


@pytest.fixture
def staged(small):
    """A small bench, the 16 frames of its plan, and their patterns."""
    plan = read_file(small.plan, PlanFile)
    with open_bench(small.bench_files) as bench:
        patterns = compute_patterns(
            plan.patterns, bench.description, plan.seed, Progress(), small.folder
        )
        yield bench, planned_shots(plan, BenchCapabilities.of(bench)), patterns


def test_each_different_picture_has_its_plan_and_none_is_rendered(staged, monkeypatch):
    def never(*args, **kwargs):
        raise AssertionError("a plan renders nothing")

    monkeypatch.setattr(simulator.imaging, "expected_electrons", never)
    monkeypatch.setattr(simulator.imaging, "moments", never)
    bench, listed, patterns = staged
    kept = effect_plans(bench, listed, patterns)
    states = [
        (one["target"], one["pattern"], one["wavelength_nm"], one["exposure_ms"])
        for one in kept["plans"]
    ]
    assert len(states) == len(set(states)) == 16
    wanted = itertools.product(["dark", "star"], ["neutral", "lens"], [540.0, 550.0], [1.0, 8.0])
    assert set(states) == set(wanted)
    for one in kept["plans"]:
        assert one["tol"] == 0.01
        assert one["decided_by"] == "estimate"
        assert one["error"] is None or one["error"] <= 0.01
        assert {told["effect"] for told in one["decisions"]} <= set(kept["effects"])
        assert all(told["why"] and told["how"] for told in one["decisions"])
    assert all(one["physics"] and one["source"] for one in kept["effects"].values())
    # A dark picture has no blur; a star's has one.
    blurred = {"dark": False, "star": True}
    for one in kept["plans"]:
        names = [told["effect"] for told in one["decisions"]]
        assert ("diffraction" in names) == blurred[one["target"]]


def test_what_is_kept_of_a_plan_takes_the_room_that_is_reserved_for_it(staged):
    bench, listed, patterns = staged
    kept = effect_plans(bench, listed, patterns)
    assert all(len(json.dumps(one, allow_nan=False)) <= _DECISIONS for one in kept["plans"])
    assert len(json.dumps(kept["effects"])) < 20_000


def test_planning_can_be_given_up(staged):
    class Enough(Exception):
        pass

    def check():
        raise Enough

    with pytest.raises(Enough):
        effect_plans(*staged, check)


def test_a_picture_that_cannot_be_made_is_the_users_error(staged):
    bench, listed, patterns = staged
    panel = bench.world.camera.panel
    listed = [one for one in listed if one.target == "star"]
    shot = type(listed[0])(**{**vars(listed[0]), "wavelength": 900e-9})
    assert panel.max_phase[-1][0] < 700e-9
    with pytest.raises(UserError, match="star with neutral at 900 nm can't be simulated: wavelen"):
        effect_plans(bench, [shot], patterns)


def test_a_record_tells_what_was_decided(small, tmp_path, labapp):
    plan = read_file(small.plan, PlanFile)
    with open_bench(small.bench_files) as bench:
        run_plan(bench, plan, tmp_path / "run.h5", folder=small.folder)
    with Record(tmp_path / "run.h5") as record:
        assert len(record.effect_plan["plans"]) == 16
    code, printed, _ = labapp("show", tmp_path / "run.h5")
    assert code == 0
    assert "What the simulator did for 16 different pictures, tolerance 0.01" in printed
    assert "read noise" in printed
    assert "of everything on, as estimated" in printed


def test_a_scene_may_ask_for_bounds(small, tmp_path, labapp):
    small.scene.write_text(scene_text(settings='decide_by = "bound"'))
    plan = read_file(small.plan, PlanFile)
    with open_bench(small.bench_files) as bench:
        assert bench.world.imaging.decide_by == "bound"
        run_plan(bench, plan, tmp_path / "run.h5", folder=small.folder)
    with Record(tmp_path / "run.h5") as record:
        assert {one["decided_by"] for one in record.effect_plan["plans"]} == {"bound"}
    _, printed, _ = labapp("show", tmp_path / "run.h5")
    assert "at most" in printed
    assert "as estimated" not in printed
    small.scene.write_text(scene_text(settings='decide_by = "guess"'))
    with (
        pytest.raises(UserError, match=r"decide_by.*'estimate' or 'bound'"),
        open_bench(small.bench_files),
    ):
        pass


def test_what_a_run_planned_before_is_found_again_when_frames_are_taken(
    small, tmp_path, monkeypatch
):
    asked = set()

    def look_up(imaging, s):
        asked.add(picture_key(s))
        return planned(imaging, s)

    planned = Imaging.plan
    monkeypatch.setattr(Imaging, "plan", look_up)
    plan = read_file(small.plan, PlanFile)
    with open_bench(small.bench_files) as bench:
        run_plan(bench, plan, tmp_path / "run.h5", folder=small.folder)
    assert len(asked) == 16


def plan(target, error, *decisions):
    keys = ("effect", "level", "relative", "estimate", "why", "forced")
    told = [dict(zip(keys, one, strict=True)) for one in decisions]
    return {"target": target, "pattern": "ring", "wavelength_nm": 550.0, "exposure_ms": 5.0,
            "tol": 0.01, "error": error, "decisions": told}  # fmt: skip


def test_the_table_tells_levels_and_where_an_effect_matters_most(capsys):
    near = plan("near", 0.003, ("defocus", "on", 0.001, 0.0, "a little", False),
                ("haze", "off", 0.002, 0.0, "thin", True))  # fmt: skip
    far = plan("far", 0.004, ("defocus", "off", 0.004, 0.001, "a lot", False))
    show_effects({"effects": {}, "plans": [near, far]})
    printed = capsys.readouterr().out
    lines = {line.split()[0]: line for line in printed.splitlines() if line.strip()}
    assert "on or off" in lines["defocus"]
    assert "4.0e-03" in lines["defocus"]
    assert "a lot" in lines["defocus"]
    assert "off, forced" in lines["haze"]
    said = "within 4.0e-03 of everything on; the farthest is far, ring, 550 nm, 5 ms"
    assert said in " ".join(printed.split())


def test_a_bound_that_is_none_is_the_largest(capsys):
    show_effects(
        {"effects": {}, "plans": [plan("one", None, ("haze", "off", None, 0.0, "?", True))]}
    )
    assert "∞" in capsys.readouterr().out


def test_an_older_record_is_shown_as_it_was(capsys):
    older = {"effect": "jitter", "on": True, "estimate": 0.02, "measure": "mean", "why": "it errs"}
    show_effects({"ring, 550 nm": {"tol": 0.01, "decisions": [older]}})
    printed = capsys.readouterr().out
    for word in ("ring, 550 nm, tolerance 0.01", "jitter", "on", "0.02", "it errs"):
        assert word in printed
