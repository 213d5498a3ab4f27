"""What a bench can't do is said before anything moves; hooks are found, called and named."""

from __future__ import annotations

from importlib.metadata import EntryPoint, EntryPoints
from typing import Any, ClassVar

import pytest
from plans import abilities, block, plan_of, tunable

from labapp.bench.opening import open_bench
from labapp.common.errors import UserError
from labapp.files.plan_file import PlanFile
from labapp.files.reading import read_file
from labapp.runs.acquisition.feasibility import (
    estimate_run,
    prompts_by_frame,
    require_feasible_plan,
)
from labapp.runs.acquisition.hooks import HookError, Hooks
from labapp.runs.acquisition.runner import run_plan
from labapp.runs.capabilities import BenchCapabilities
from labapp.runs.state import State
from labapp.runs.steps import planned_shots

WHEEL, TUNABLE = abilities(), tunable()


def refusal(plan: PlanFile, able: BenchCapabilities) -> str:
    with pytest.raises(UserError) as caught:
        require_feasible_plan(plan, able, "plan.toml")
    return str(caught.value)


@pytest.mark.parametrize(
    ("changes", "able", "words"),
    [
        (
            {"targets": ["star", "moon"]},
            WHEEL,
            "key 'acquire.1.targets' names 'moon', which this bench doesn't have. Choose among "
            "dark, star, photograph, flat.",
        ),
        (
            {"interleave": [{"role": "dark", "target": "cap"}]},
            WHEEL,
            "key 'acquire.1.interleave' names 'cap', which this bench doesn't have. Choose among "
            "dark, star, photograph, flat.",
        ),
        (
            {"interleave": [{"role": "flat"}]},
            abilities(targets=("dark", "star")),
            "key 'acquire.1.interleave' names 'flat', which this bench doesn't have. Choose among "
            "dark, star.",
        ),
        (
            {"wavelengths_nm": [532, 719.9, 720.1]},
            TUNABLE,
            "key 'acquire.1.wavelengths_nm' has 720.1, out of the filter's range. Choose 420 to "
            "720 nm.",
        ),
        (
            {"wavelengths_nm": [500]},
            WHEEL,
            "key 'acquire.1.wavelengths_nm' has 500, and no slot of the filter wheel passes it. "
            "Choose among 450, 532, 633 nm.",
        ),
        (
            {"wavelengths_nm": None, "slots": [5]},
            WHEEL,
            "key 'acquire.1.slots' has 5, and this bench's filter has 4 slots. Choose 1 to 4.",
        ),
        (
            {"wavelengths_nm": None, "slots": [1]},
            TUNABLE,
            "key 'acquire.1.slots' has 1, and this bench's filter has no slots. Choose "
            "wavelengths_nm instead.",
        ),
        (
            {"exposures_ms": [1, 0.019]},
            WHEEL,
            "key 'acquire.1.exposures_ms' has 0.019 ms, out of the camera's range. Choose 0.02 to "
            "30000 ms.",
        ),
        (
            {"exposures_ms": [30000.1]},
            WHEEL,
            "key 'acquire.1.exposures_ms' has 30000.1 ms, out of the camera's range. Choose 0.02 "
            "to 30000 ms.",
        ),
        (
            {"patterns": ["three"], "exposures_ms": None, "periods": [600, 601]},
            WHEEL,
            "key 'acquire.1.periods' has 601, which last 30050 ms, out of the camera's range. "
            "Choose 0.02 to 30000 ms.",
        ),
        (
            {"patterns": ["neutral", "three"], "exposures_ms": [50, 75]},
            WHEEL,
            "key 'acquire.1.exposures_ms' has 75 ms, which cuts the video 'three' within its "
            "period of 50.000 ms. Ask for 'periods' instead, or set any_exposure = true.",
        ),
        (
            {"patterns": ["three"], "exposures_ms": [10]},
            WHEEL,
            "key 'acquire.1.exposures_ms' has 10 ms, which cuts the video 'three' within its "
            "period of 50.000 ms. Ask for 'periods' instead, or set any_exposure = true.",
        ),
    ],
)
def test_what_a_bench_cannot_do_is_named_with_what_it_can(changes, able, words):
    """The second block is wrong, and the message says so."""
    assert refusal(plan_of(block(), block(**changes)), able) == f"plan.toml: {words}"


@pytest.mark.parametrize(
    "changes",
    [
        {"exposures_ms": [0.02, 30000]},
        {"wavelengths_nm": [420, 720]},
        {"patterns": ["three"], "exposures_ms": [10], "any_exposure": True},
        {"patterns": ["three"], "exposures_ms": [50, 150]},
        {"patterns": ["two", "three"], "exposures_ms": None, "periods": [1, 7]},
        {"targets": ["near"]},
    ],
)
def test_what_a_bench_can_do_is_not_refused(changes):
    require_feasible_plan(
        plan_of(block(**changes), targets={"near": {"place": "star"}}), TUNABLE, "plan.toml"
    )


def test_a_filter_that_begins_at_400_nm_takes_400_nm():
    require_feasible_plan(
        plan_of(block(wavelengths_nm=[400])), tunable(wavelength_range=(400e-9, 720e-9)), ""
    )


NEAR_AND_FAR = {
    "near": {"place": "star", "prompt": "Move the star to 1 m."},
    "far": {"place": "star", "prompt": "Move the star to 3 m."},
}


def test_a_person_is_asked_once_for_each_change_of_target():
    plan = plan_of(
        block(targets=["near", "far"], exposures_ms=[1, 8]),
        block(targets=["far", "photograph", "near"]),
        targets=NEAR_AND_FAR,
    )
    listed = planned_shots(plan, WHEEL)
    near, far = (target["prompt"] for target in NEAR_AND_FAR.values())
    assert list(prompts_by_frame(listed, WHEEL).values()) == [near, far, near]
    # Two frames near and two far; one far, without a word, a photograph, and one near.
    assert prompts_by_frame(listed, WHEEL) == {0: near, 2: far, 6: near}


def test_a_person_who_places_the_targets_is_asked_for_all_of_them():
    able = abilities(by_hand=True)
    plan = plan_of(block(targets=["near", "photograph"]), targets=NEAR_AND_FAR)
    assert list(prompts_by_frame(planned_shots(plan, able), able).values()) == [
        "Move the star to 1 m.",
        "Place photograph, then press Enter.",
    ]


def test_frames_and_seconds_are_summed():
    plan = plan_of(block(exposures_ms=[1, 8], repeats=3))
    expected = estimate_run(planned_shots(plan, WHEEL), plan, WHEEL)
    assert (expected.frames, expected.prompts) == (6, ())
    # Targets settle once, in half a second; six frames are read out in 8 ms each.
    assert expected.seconds == pytest.approx(0.5 + 3 * 0.001 + 3 * 0.008 + 6 * 0.008)


@pytest.mark.parametrize("frames", [1, 40])
@pytest.mark.parametrize("patterns", [["neutral"], ["neutral", "lens", "grey", "two"]])
def test_the_disk_need_is_what_the_record_takes_and_little_more(small, tmp_path, frames, patterns):
    plan = plan_of(
        block(patterns=patterns, exposures_ms=None, periods=[1], repeats=frames)
        if "two" in patterns
        else block(patterns=patterns, repeats=frames)
    )
    with open_bench(small.bench_files) as bench:
        able = BenchCapabilities.of(bench)
        expected = estimate_run(planned_shots(plan, able), plan, able)
        outcome = run_plan(bench, plan, tmp_path / "run.h5")
    assert outcome.state is State.COMPLETE
    taken = outcome.path.stat().st_size
    assert taken <= expected.disk_bytes <= 1.5 * taken


class Diary:
    """A hook that writes down what it is told, and fails when it shall."""

    entries: ClassVar[list[tuple[str, ...]]] = []
    fails_at: ClassVar[str] = ""

    def __init__(self, name: str) -> None:
        self._name = name

    def _note(self, moment: str, what: object) -> None:
        self.entries.append((self._name, moment, str(what)))
        if moment == self.fails_at:
            raise OSError("no ink")

    def before_run(self, listed: Any) -> None:
        self._note("before_run", len(listed))

    def before_frame(self, shot: Any) -> None:
        self._note("before_frame", shot.index)

    def after_frame(self, shot: Any, frame: Any) -> None:
        self._note("after_frame", frame.image.shape)

    def after_run(self, state: str) -> None:
        self._note("after_run", state)


def make_diary(plan: PlanFile, bench: Any) -> Diary:
    return Diary("diary")


def make_other(plan: PlanFile, bench: Any) -> Diary:
    return Diary("other")


def make_nothing(plan: PlanFile, bench: Any) -> object:
    """Hooks may leave out what they don't care for."""
    return object()


def make_trouble(plan: PlanFile, bench: Any) -> object:
    raise OSError("the lamp is not plugged in")


@pytest.fixture
def installed(monkeypatch) -> None:
    """Hooks that somebody's package provides."""
    made = {"diary": "make_diary", "other": "make_other", "nothing": "make_nothing"}
    made |= {"trouble": "make_trouble", "gone": "no_such_name"}
    found = EntryPoints(
        EntryPoint(name, f"{__name__}:{function}", "labapp.hooks")
        for name, function in made.items()
    )
    for module in ("feasibility", "hooks"):
        monkeypatch.setattr(
            f"labapp.runs.acquisition.{module}.entry_points",
            lambda *, group: found.select(group=group),
        )
    monkeypatch.setattr(Diary, "entries", [])
    monkeypatch.setattr(Diary, "fails_at", "")


@pytest.fixture
def run_with(small, tmp_path, installed):
    """A run of a plan of two frames with hooks, on the small bench."""

    def run(*hooks: str):
        plan = read_file(small.plan, PlanFile).model_dump()
        plan |= {"hooks": hooks, "acquire": [block(exposures_ms=[1, 8])]}
        with open_bench(small.bench_files) as bench:
            return run_plan(bench, PlanFile.model_validate(plan), tmp_path / "run.h5")

    return run


def test_a_hook_that_is_not_installed_is_named_with_those_that_are(installed):
    assert refusal(plan_of(block(), hooks=["diary", "lamp"]), WHEEL) == (
        "plan.toml: key 'hooks' names 'lamp', which isn't installed. "
        "Installed: diary, gone, nothing, other, trouble."
    )


def test_without_any_hook_installed_it_says_none():
    assert refusal(plan_of(block(), hooks=["lamp"]), WHEEL).endswith("Installed: none.")


@pytest.mark.parametrize(
    ("hook", "why"), [("trouble", "the lamp is not plugged in"), ("gone", "no_such_name")]
)
def test_a_hook_that_cannot_be_made_leaves_everything_as_it_was(run_with, tmp_path, hook, why):
    with pytest.raises(UserError, match=rf"hook '{hook}' doesn't load: .*{why}"):
        run_with("diary", hook)
    assert not (tmp_path / "run.h5").exists()
    assert Diary.entries == []


def test_hooks_are_called_in_the_plans_order_at_every_moment(run_with):
    assert run_with("other", "nothing", "diary").state is State.COMPLETE
    moments = [
        ("before_run", "2"),
        ("before_frame", "0"),
        ("after_frame", "(64, 96)"),
        ("before_frame", "1"),
        ("after_frame", "(64, 96)"),
        ("after_run", "COMPLETE"),
    ]
    assert Diary.entries == [(name, *moment) for moment in moments for name in ("other", "diary")]


@pytest.mark.parametrize(
    ("moment", "missing"),
    [("before_run", 2), ("before_frame", 2), ("after_frame", 1), ("after_run", 0)],
)
def test_a_hook_that_fails_ends_the_run_and_is_named(run_with, monkeypatch, moment, missing):
    monkeypatch.setattr(Diary, "fails_at", moment)
    outcome = run_with("diary", "other")
    assert outcome.state is State.FAILED
    assert len(outcome.missing) == missing
    assert f"hook 'diary', {moment}: OSError: no ink" in outcome.message


def test_hooks_after_one_that_fails_are_not_called(installed, monkeypatch):
    monkeypatch.setattr(Diary, "fails_at", "before_run")
    hooks = Hooks([("diary", Diary("diary")), ("other", Diary("other"))])
    with pytest.raises(HookError, match=r"^hook 'diary', before_run: OSError: no ink$"):
        hooks.call("before_run", [])
    assert [name for name, *_ in Diary.entries] == ["diary"]
