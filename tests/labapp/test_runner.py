"""The engine: states, safety, honesty about what was taken."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.errors import DeviceError
from labapp.acquisition.runner import run_plan
from labapp.acquisition.state import State
from labapp.acquisition.steps import expected_seconds, shots
from labapp.bench import open_bench
from labapp.errors import UserError
from labapp.files.plan_file import PlanFile
from labapp.files.reading import read_toml
from labapp.record.reader import Record
from optics.progress import Progress


@pytest.fixture
def plan(small) -> PlanFile:
    return read_toml(small.plan, PlanFile)


@pytest.fixture
def bench(small):
    with open_bench(small.bench_files) as opened:
        yield opened


def is_safe(bench) -> bool:
    return bench.slm.shown == "neutral" and not bench.world.grey.any()


def test_a_plan_is_the_product_of_its_axes(plan):
    taken = shots(plan)
    # 2 targets x 2 patterns x 2 wavelengths x 2 exposures
    assert len(taken) == 16
    assert len({(s.target, s.pattern, s.wavelength, s.exposure) for s in taken}) == 16
    assert [s.index for s in taken] == list(range(16))


def test_the_expected_duration_is_that_of_exposures_and_read_outs(plan, bench):
    # 8 frames of 1 ms and 8 of 8 ms, each read out in 8 ms.
    assert expected_seconds(plan, bench) == pytest.approx(8 * (1 + 8) * 1e-3 + 16 * 8e-3)


def test_a_run_is_complete_when_every_frame_reads_back(plan, bench, tmp_path):
    outcome = run_plan(bench, plan, tmp_path / "run.h5")
    assert (outcome.state, outcome.missing) == (State.COMPLETE, [])
    assert is_safe(bench)
    with Record(outcome.path) as record:
        assert record.state is State.COMPLETE
        assert record.missing() == []
        np.testing.assert_array_equal(record.column("exposure"), record.column("exposure_asked"))
        np.testing.assert_array_equal(
            record.column("wavelength"), record.column("wavelength_asked")
        )


def test_nothing_is_measured_while_anything_settles(plan, bench, tmp_path):
    ready = [0.0]
    began = []
    for device, name in ((bench.slm, "show"), (bench.filter, "set_wavelength")):
        original = getattr(device, name)

        def noted(*args, original=original):
            setting = original(*args)
            ready.append(setting.ready_at)
            return setting

        setattr(device, name, noted)
    capture = bench.camera.capture

    def watched(cancelled):
        frame = capture(cancelled)
        began.append((frame.time, max(ready)))
        return frame

    bench.camera.capture = watched
    run_plan(bench, plan, tmp_path / "run.h5")
    assert len(began) == 16
    assert all(time >= stands for time, stands in began)
    assert max(ready) > 0


def test_settling_overlaps(plan, bench, tmp_path):
    """Pattern and filter change together and are waited for once: 50 ms, not 100."""
    run_plan(bench, plan, tmp_path / "run.h5")
    with Record(tmp_path / "run.h5") as record:
        time, exposure = record.column("time"), record.column("exposure")
    gaps = np.diff(time) - exposure[:-1] - 8e-3
    assert gaps.max() == pytest.approx(50e-3, abs=1e-9)


def test_the_record_says_what_each_frame_was_taken_with(plan, bench, tmp_path):
    seen = []
    capture = bench.camera.capture

    def watched(cancelled):
        seen.append((bench.world.target, bench.slm.shown, bench.world.wavelength))
        return capture(cancelled)

    bench.camera.capture = watched
    run_plan(bench, plan, tmp_path / "run.h5")
    with Record(tmp_path / "run.h5") as record:
        targets = [record.target_names[i] for i in record.column("target")]
        patterns = [record.pattern_names[i] for i in record.column("pattern")]
        wavelengths = record.column("wavelength").tolist()
    assert seen == list(zip(targets, patterns, wavelengths, strict=True))


def test_a_cancelled_run_is_safe_readable_and_says_what_is_missing(plan, bench, tmp_path):
    progress = Progress()

    def stop_at_five(shot, frame):
        if shot.index == 4:
            progress.cancel()

    outcome = run_plan(bench, plan, tmp_path / "run.h5", progress=progress, on_frame=stop_at_five)
    assert outcome.state is State.CANCELLED
    assert outcome.missing == list(range(5, 16))
    assert is_safe(bench)
    with Record(outcome.path) as record:
        assert record.state is State.CANCELLED
        assert record.image(4).any()


def failing(*args):
    raise DeviceError("camera", "capture", "link lost", "Check the cable")


@pytest.mark.parametrize(
    ("device", "call"),
    [("camera", "capture"), ("slm", "show"), ("filter", "set_wavelength"), ("targets", "place")],
)
def test_a_failing_device_ends_the_run_as_failed(plan, bench, tmp_path, device, call, monkeypatch):
    original = getattr(getattr(bench, device), call)
    calls = iter(range(100))

    def fail_once(*args):
        return failing() if next(calls) == 0 else original(*args)

    monkeypatch.setattr(getattr(bench, device), call, fail_once)
    outcome = run_plan(bench, plan, tmp_path / "run.h5")
    assert outcome.state is State.FAILED
    assert outcome.missing
    assert "link lost" in outcome.message
    assert is_safe(bench)
    with Record(outcome.path) as record:
        assert record.state is State.FAILED
        assert "Check the cable" in record.message


def test_a_frame_of_the_wrong_exposure_is_not_taken(plan, bench, tmp_path, monkeypatch):
    capture = bench.camera.capture

    def stale(cancelled):
        from dataclasses import replace

        return replace(capture(cancelled), exposure=0.123)

    monkeypatch.setattr(bench.camera, "capture", stale)
    outcome = run_plan(bench, plan, tmp_path / "run.h5")
    assert outcome.state is State.FAILED
    assert outcome.missing == list(range(16))
    assert "123 ms" in outcome.message


def test_every_device_is_made_safe_even_if_one_refuses(plan, bench, tmp_path, monkeypatch):
    monkeypatch.setattr(bench.filter, "make_safe", failing)
    outcome = run_plan(bench, plan, tmp_path / "run.h5")
    assert is_safe(bench)
    assert "not left safe" in outcome.message or "link lost" in outcome.message
    monkeypatch.undo()


def test_same_seed_same_arrays_and_another_seed_others(small, plan, tmp_path):
    from labapp.figures.durability import differing_arrays

    paths = [tmp_path / f"{name}.h5" for name in "abc"]
    for path, seed in zip(paths, (3, 3, 4), strict=True):
        with open_bench(small.bench_files) as bench:
            run_plan(bench, plan.model_copy(update={"seed": seed}), path)
    assert differing_arrays(paths[0], paths[1]) == []
    assert "entry/data/images" in differing_arrays(paths[0], paths[2])


def test_a_run_that_cannot_be_done_moves_nothing(small, plan, bench, tmp_path, monkeypatch):
    monkeypatch.setattr(bench.slm, "show", failing)
    block = plan.acquire[0].model_copy(update={"exposures_ms": (1e6,)})
    with pytest.raises(UserError, match="out of the camera's range"):
        run_plan(bench, plan.model_copy(update={"acquire": (block,)}), tmp_path / "run.h5")
    monkeypatch.undo()
    assert not (tmp_path / "run.h5").exists()


def test_a_pattern_is_shown_even_if_the_panel_has_another_of_that_name(small, plan, tmp_path):
    """The panel's own neutral is grey 0; the plan's is grey 100."""
    patterns = {"neutral": {"kind": "constant", "grey": 100}}
    block = plan.acquire[0].model_copy(update={"patterns": ("neutral",)})
    changed = PlanFile.model_validate(
        plan.model_dump() | {"patterns": patterns, "acquire": [block.model_dump()]}
    )
    seen = []
    with open_bench(small.bench_files) as bench:
        run_plan(
            bench,
            changed,
            tmp_path / "run.h5",
            on_frame=lambda shot, frame: seen.append(int(bench.world.grey[0, 0])),
        )
    assert set(seen) == {100}


def test_the_record_logs_what_was_set_and_how_the_run_ended(plan, bench, tmp_path, caplog):
    run_plan(bench, plan, tmp_path / "run.h5")
    with Record(tmp_path / "run.h5") as record:
        texts = [text for _, text in record.log]
        times = [time for time, _ in record.log]
    assert texts[0] == "started: 16 frames planned"
    assert texts[1:4] == ["target: dark", "pattern: neutral", "wavelength: 540 nm"]
    assert texts.count("pattern: lens") == 2
    assert texts[-1] == "all frames taken"
    assert times == sorted(times)
