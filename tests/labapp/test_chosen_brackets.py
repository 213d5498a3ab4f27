"""Plans whose exposures are chosen for a signal-to-noise ratio: metered, settled, kept, resumed."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from figures.durability import differing_arrays
from plans import abilities, block, plan_of, tunable

from labapp.bench.opening import open_bench
from labapp.common.errors import UserError
from labapp.files.plan_file import PlanFile
from labapp.files.reading import validate
from labapp.runs.acquisition import hooks
from labapp.runs.acquisition.attendance import Attendance
from labapp.runs.acquisition.runner import resume_run, run_plan
from labapp.runs.brackets.choice import possible_plans
from labapp.runs.record.reader import Record
from labapp.runs.state import State
from optics.camera import Sensor
from optics.hdr import Bracket, merge
from optics.progress import Progress

SENSOR = Sensor()
WANTED = {"snr_db": 26, "decades": 2}


def bracket_plan(**changes: Any) -> PlanFile:
    keys: dict[str, Any] = {
        "patterns": ["neutral", "lens"],
        "exposures_ms": None,
        "bracket": WANTED,
        "interleave": [{"role": "dark", "frames": 4}],
    }
    return plan_of(block(**keys | changes), seed=3)


@pytest.fixture
def bench(small):
    with open_bench(small.bench_files) as opened:
        yield opened


@pytest.fixture
def record(bench, tmp_path):
    outcome = run_plan(bench, bracket_plan(), tmp_path / "run.h5")
    assert (outcome.state, outcome.message) == (State.COMPLETE, "")
    with Record(outcome.path) as opened:
        yield opened


def test_a_record_holds_the_exposures_and_why_they_were_chosen(record):
    (settled,) = record.plan.acquire
    assert settled.bracket is None
    assert settled.chosen is not None
    assert settled.chosen.wanted.snr_db == 26
    assert settled.chosen.darks == 4
    assert settled.chosen.frames == len(settled.exposures_ms)
    low, high = settled.chosen.electrons_per_s
    metered = {(one.target, one.pattern): one for one in settled.chosen.metered}
    assert set(metered) == {("star", "neutral"), ("star", "lens")}
    # The lens blurs the star: its own brightest pixel is dimmer, and the range holds both.
    ends = [metered["star", name].electrons_per_s for name in ("neutral", "lens")]
    assert (low, high) == (min(one for one, _ in ends), max(one for _, one in ends))
    assert ends[0][1] / ends[0][0] == pytest.approx(100)
    assert [one.name for one in settled.chosen.alternatives] == ["x2", "x4", "x8"]
    assert all(settled.chosen.frames <= one.frames for one in settled.chosen.alternatives)
    assert any("chosen: " in text and "26 dB" in text for _, text in record.log)


def test_the_merged_record_reaches_the_ratio(record):
    """The brightest pixels of the frames, merged, differ from each other's by what was wanted."""
    exposures = record.column("exposure")
    roles, patterns = record.column("role"), record.column("pattern")
    light = [n for n in range(record.frame_count) if roles[n] == 0 and patterns[n] == 0]
    dark = [n for n in range(record.frame_count) if roles[n] != 0]
    times = [float(exposures[n]) for n in light]
    level = {
        t: np.mean([record.image(n) for n in dark if exposures[n] == t], axis=0) for t in set(times)
    }
    frames = [np.array(record.image(n), dtype=float) for n in light]
    merged = merge(Bracket(frames, times, [level[t] for t in times], [4] * len(times), SENSOR))
    rate, variance = merged.rate.numpy(), merged.variance.numpy()
    low, high = record.plan.acquire[0].chosen.electrons_per_s
    inside = (rate > 1.05 * low) & (rate < high)
    assert inside.sum() > 20
    reached = 20 * np.log10(rate[inside] / np.sqrt(variance[inside]))
    assert (reached >= 26 - 0.3).mean() >= 0.95


def test_a_resumed_run_takes_the_same_bracket(bench, tmp_path):
    whole = run_plan(bench, bracket_plan(), tmp_path / "whole.h5")
    progress, taken = Progress(), []

    def stop(shot, frame) -> None:
        taken.append(shot.index)
        if len(taken) == 5:
            progress.cancel()

    path = tmp_path / "half.h5"
    half = run_plan(bench, bracket_plan(), path, Attendance(progress=progress, on_frame=stop))
    assert half.state is State.CANCELLED
    assert resume_run(bench, path).state is State.COMPLETE
    assert differing_arrays(whole.path, path) == []


def test_a_scene_that_changed_since_metering_is_told(bench, tmp_path, monkeypatch):
    """Somebody dims the star by a fifth when the run's first frame is taken."""

    class Dimmer:
        def before_run(self, listed) -> None:
            star = bench.world.scene.targets["star"]
            dimmed = replace(star, radiance=0.8 * star.radiance)
            scene = replace(bench.world.scene, targets=bench.world.scene.targets | {"star": dimmed})
            monkeypatch.setattr(bench.world, "scene", scene)

    monkeypatch.setattr(hooks.Hooks, "of", lambda plan, bench: hooks.Hooks([("dimmer", Dimmer())]))
    outcome = run_plan(bench, bracket_plan(), tmp_path / "run.h5")
    assert outcome.state is State.COMPLETE
    said = outcome.message.split("star with neutral at 532 nm: the scene has ")[1]
    assert float(said.split()[0]) == pytest.approx(0.8, abs=0.03)
    with Record(outcome.path) as record:
        assert any("times the light that was metered" in text for _, text in record.log)


def test_exposures_are_whole_periods_of_the_flicker_and_of_videos(small, tmp_path):
    text = small.bench.read_text().replace("version = 1", "version = 1\nflicker_hz = 500")
    small.bench.write_text(text)
    with open_bench(small.bench_files) as bench:
        outcome = run_plan(bench, bracket_plan(patterns=["lens"]), tmp_path / "run.h5")
    with Record(outcome.path) as record:
        periods = record.column("exposure") / 2e-3
        assert record.bench.flicker_hz == 500
    np.testing.assert_allclose(periods, periods.round(), atol=1e-3)
    rates = {"snr_db": 20, "electrons_per_s": [100, 1000]}
    video = plan_of(block(patterns=["two"], exposures_ms=None, bracket=rates))
    for able, period in ((abilities(), 2 / 60), (abilities(flicker_period=0.01), 0.1)):
        (settled,) = possible_plans(video, able, SENSOR, "plan")
        times = np.array(settled.acquire[0].exposures_ms) * 1e-3 / period
        np.testing.assert_allclose(times, times.round(), atol=1e-3)
    free = block(patterns=["two"], exposures_ms=None, bracket=rates, any_exposure=True)
    (settled,) = possible_plans(plan_of(free), abilities(), SENSOR, "plan")
    assert settled.acquire[0].exposures_ms[-1] % (2000 / 60) > 1


def test_a_given_range_is_settled_without_metering(bench, tmp_path, monkeypatch):
    monkeypatch.setattr("optics.hdr.Meter.add", lambda *_: pytest.fail("a frame was metered"))
    wanted = {"snr_db": 20, "electrons_per_s": [1e3, 1e5], "least": "frames"}
    outcome = run_plan(bench, bracket_plan(bracket=wanted), tmp_path / "run.h5")
    with Record(outcome.path) as record:
        assert record.plan.acquire[0].chosen.metered == ()
        assert record.plan.acquire[0].chosen.electrons_per_s == (1e3, 1e5)


def test_the_plan_says_beforehand_what_it_takes_at_least_and_at_most(labapp, small):
    text = small.plan.read_text().replace(
        "exposures_ms = [1, 8]", "bracket = { snr_db = 26, decades = 2 }"
    )
    small.plan.write_text(text.replace('["dark", "star"]', '["star"]'))
    code, printed, _ = labapp("plan", "check", small.plan, *small.arguments())
    assert code == 0
    assert " frames\n" in printed
    assert "exposures of block 1 are chosen by metering" in printed
    code, printed, _ = labapp("plan", "show", small.plan, *small.arguments(), "--json")
    data = json.loads(printed)
    assert 4 <= data["frames"] < data["most_frames"]
    assert 0 < data["seconds"] < data["most_seconds"]
    assert 0 < data["disk_bytes"] < data["most_disk_bytes"]
    record = small.folder / "run.h5"
    assert labapp("run", small.plan, *small.arguments(), "--out", record)[0] == 0
    with Record(record) as opened:
        assert data["frames"] <= opened.frame_count <= data["most_frames"]
        assert data["seconds"] <= opened.expected_seconds <= data["most_seconds"]


def test_a_target_without_light_is_named(bench, tmp_path):
    with pytest.raises(UserError, match="metering dark with neutral at 532 nm: nothing is seen"):
        run_plan(bench, bracket_plan(targets=["dark"], patterns=["neutral"]), tmp_path / "run.h5")
    assert not (tmp_path / "run.h5").exists()
    assert bench.slm.displayed_pattern == "neutral"


def test_a_ratio_out_of_reach_is_refused_before_anything_is_written(bench, tmp_path):
    wanted = {"snr_db": 60, "electrons_per_s": [1, 1e5], "most_frames": 2}
    with pytest.raises(UserError, match="with 2 frames of at most 30000 ms"):
        run_plan(bench, bracket_plan(bracket=wanted), tmp_path / "run.h5")
    assert not (tmp_path / "run.h5").exists()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"exposures_ms": [1]}, "a block has either exposures_ms, periods or bracket"),
        ({"bracket": {"decades": 3}}, "acquire.0.bracket.snr_db"),
        ({"bracket": {"snr_db": 90}}, "acquire.0.bracket.snr_db' is 90"),
        ({"bracket": {"snr_db": math.inf}}, "acquire.0.bracket.snr_db"),
        ({"bracket": {"snr_db": 30, "decades": 0}}, "acquire.0.bracket.decades' is 0"),
        ({"bracket": WANTED | {"electrons_per_s": [1, 2]}}, "either decades or electrons_per_s"),
        ({"bracket": {"snr_db": 30, "electrons_per_s": [2, 1]}}, "lower rate first"),
        ({"together": [["pattern", "exposure"]]}, "can't step together"),
    ],
)
def test_a_wrong_bracket_is_refused_with_its_key(changes, message):
    keys = {"patterns": ["neutral", "lens"], "exposures_ms": None, "bracket": WANTED} | changes
    plan = {
        "version": 1,
        "title": "Plan",
        "patterns": {"neutral": {"kind": "constant"}, "lens": {"kind": "constant", "grey": 9}},
        "acquire": [block(**keys)],
    }
    with pytest.raises(UserError) as caught:
        validate(plan, PlanFile, "plan.toml")
    assert message in str(caught.value)


def test_limits_that_leave_no_exposure_are_named():
    keys = {"exposures_ms": None, "bracket": WANTED | {"longest_ms": 5}}
    with pytest.raises(UserError, match="no exposure time"):
        possible_plans(plan_of(block(**keys)), tunable(flicker_period=0.01), SENSOR, "plan")
