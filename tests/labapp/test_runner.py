"""The engine: states, safety, honesty about what was taken."""

from __future__ import annotations

import errno
import os
import threading
import time

import h5py
import numpy as np
import pytest
from figures.durability import differing_arrays
from plans import block, plan_of

from drivers.errors import DeviceError
from labapp.bench.opening import open_bench
from labapp.common.errors import UserError
from labapp.files.plan_file import PlanFile
from labapp.files.reading import read_file
from labapp.runs.acquisition import feasibility, frame_storage, hooks
from labapp.runs.acquisition.attendance import Attendance
from labapp.runs.acquisition.feasibility import estimate_run
from labapp.runs.acquisition.runner import RunRequest, resume_run, run_all, run_plan
from labapp.runs.capabilities import BenchCapabilities
from labapp.runs.record.reader import Record
from labapp.runs.state import State
from labapp.runs.steps import planned_shots
from optics.light import Waveform
from optics.progress import Progress
from simulator.devices import SimulatedFilter


@pytest.fixture
def plan(small) -> PlanFile:
    return read_file(small.plan, PlanFile)


@pytest.fixture
def bench(small):
    with open_bench(small.bench_files) as opened:
        yield opened


def is_safe(bench) -> bool:
    return bench.slm.displayed_pattern == "neutral" and not bench.world.grey.any()


def test_the_expected_duration_is_that_of_exposures_read_outs_and_settling(plan, bench):
    """8 frames of 1 ms and 8 of 8 ms, each read out in 8 ms; 8 changes settle for 50 ms."""
    abilities = BenchCapabilities.of(bench)
    expected = estimate_run(planned_shots(plan, abilities), plan, abilities)
    assert expected.seconds == pytest.approx(8 * (1 + 8) * 1e-3 + 16 * 8e-3 + 8 * 50e-3)


def test_a_virtual_run_takes_the_time_that_was_expected(plan, bench, tmp_path):
    outcome = run_plan(bench, plan, tmp_path / "run.h5")
    assert outcome.elapsed_seconds == pytest.approx(outcome.expected_seconds)


def test_a_run_is_complete_when_every_frame_reads_back(plan, bench, tmp_path):
    outcome = run_plan(bench, plan, tmp_path / "run.h5")
    assert (outcome.state, outcome.missing) == (State.COMPLETE, [])
    assert is_safe(bench)
    with Record(outcome.path) as record:
        assert record.state is State.COMPLETE
        assert record.missing_frames() == []
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
    assert time[0] == pytest.approx(50e-3)


def test_the_record_says_what_each_frame_was_taken_with(plan, bench, tmp_path):
    seen = []
    capture = bench.camera.capture

    def watched(cancelled):
        seen.append((bench.world.target, bench.slm.displayed_pattern, bench.world.wavelength))
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

    outcome = run_plan(
        bench, plan, tmp_path / "run.h5", Attendance(progress=progress, on_frame=stop_at_five)
    )
    assert outcome.state is State.CANCELLED
    assert outcome.missing == list(range(5, 16))
    assert is_safe(bench)
    with Record(outcome.path) as record:
        assert record.state is State.CANCELLED
        assert record.image(4).any()


def changed(plan: PlanFile, **keys) -> PlanFile:
    return PlanFile.model_validate(plan.model_dump() | keys)


def failing(*args):
    raise DeviceError("camera", "capture", "link lost", "Check the cable")


COMMANDS = [
    ("camera", "capture"),
    ("slm", "show"),
    ("filter", "set_wavelength"),
    ("targets", "place"),
]


@pytest.mark.parametrize(("device", "call"), COMMANDS)
def test_a_device_that_goes_on_failing_ends_the_run_as_failed(
    plan, bench, tmp_path, device, call, monkeypatch
):
    monkeypatch.setattr(getattr(bench, device), call, failing)
    outcome = run_plan(bench, plan, tmp_path / "run.h5")
    assert outcome.state is State.FAILED
    assert outcome.missing == list(range(16))
    assert "link lost" in outcome.message
    assert is_safe(bench)
    with Record(outcome.path) as record:
        assert record.state is State.FAILED
        assert "Check the cable" in record.message
        tried = [text for _, text in record.log if "attempt" in text]
    for number, text in enumerate(tried, start=1):
        assert text.startswith(f"frame 0, attempt {number} of 3: ")
    assert len(tried) == 3


@pytest.mark.parametrize(("device", "call"), COMMANDS)
def test_a_failure_that_passes_is_tried_again_and_recorded(
    plan, bench, tmp_path, device, call, monkeypatch
):
    original = getattr(getattr(bench, device), call)
    calls = iter(range(1000))

    def fail_once(*args):
        return failing() if next(calls) == 1 else original(*args)

    run_plan(bench, plan, tmp_path / "quiet.h5")
    monkeypatch.setattr(getattr(bench, device), call, fail_once)
    outcome = run_plan(bench, plan, tmp_path / "run.h5")
    assert (outcome.state, outcome.missing) == (State.COMPLETE, [])
    with Record(outcome.path) as record:
        attempts = record.column("attempts")
        assert sorted(attempts)[-2:] == [1, 2]
        assert any("attempt 1 of 3" in text and "link lost" in text for _, text in record.log)
    assert differing_arrays(tmp_path / "quiet.h5", outcome.path) == []


def test_a_plan_may_ask_for_no_second_attempt(plan, bench, tmp_path, monkeypatch):
    calls = iter(range(1000))
    capture = bench.camera.capture

    def fail_once(*args):
        return failing() if next(calls) == 3 else capture(*args)

    monkeypatch.setattr(bench.camera, "capture", fail_once)
    once = changed(plan, retry={"attempts": 1})
    outcome = run_plan(bench, once, tmp_path / "run.h5")
    assert (outcome.state, outcome.missing) == (State.FAILED, list(range(3, 16)))


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


def test_a_run_ends_at_the_first_frame_above_the_full_scale(plan, bench, tmp_path, monkeypatch):
    taken, capture = iter(range(1000)), bench.camera.capture

    def swapped(cancelled):
        from dataclasses import replace

        frame = capture(cancelled)
        return replace(frame, image=frame.image.byteswap()) if next(taken) == 2 else frame

    monkeypatch.setattr(bench.camera, "capture", swapped)
    outcome = run_plan(bench, plan, tmp_path / "run.h5")
    assert (outcome.state, outcome.missing) == (State.FAILED, list(range(2, 16)))
    assert "its full scale is" in outcome.message


def test_every_device_is_made_safe_even_if_one_refuses(plan, bench, tmp_path, monkeypatch):
    monkeypatch.setattr(SimulatedFilter, "make_safe", failing)
    outcome = run_plan(bench, plan, tmp_path / "run.h5")
    assert is_safe(bench)
    assert outcome.state is State.COMPLETE
    assert "not left safe" in outcome.message
    assert "link lost" in outcome.message
    monkeypatch.undo()


def test_same_seed_same_arrays_and_another_seed_others(small, plan, tmp_path):
    paths = [tmp_path / f"{name}.h5" for name in "abc"]
    for path, seed in zip(paths, (3, 3, 4), strict=True):
        with open_bench(small.bench_files) as bench:
            run_plan(bench, plan.model_copy(update={"seed": seed}), path)
    assert differing_arrays(paths[0], paths[1]) == []
    assert "entry/data/images" in differing_arrays(paths[0], paths[2])


FLICKER = """
[lights.mains]
kind = "broadband"
[lights.mains.flicker]
shape = "sine"
depth = 0.6
[targets.wall]
kind = "flat"
distance_m = 2.0
radiance = 1.0
light = "mains"
"""


def test_each_frame_sees_a_lamp_as_it_is_at_its_moment_of_the_plan(tiny, tmp_path):
    """Also the frames that a resumption takes, whenever that is."""
    scene = tiny.scene.read_text().replace("version = 1", "version = 2")
    tiny.scene.write_text(scene + FLICKER)
    plan = plan_of(block(targets=["wall"], wavelengths_nm=[550], repeats=6))
    progress, path = Progress(), tmp_path / "run.h5"

    def stop(shot, frame):
        if shot.index == 2:
            progress.cancel()

    with open_bench(tiny.bench_files) as bench:
        run_plan(bench, plan, path, Attendance(progress=progress, on_frame=stop))
        listed = planned_shots(plan, BenchCapabilities.of(bench))
    with open_bench(tiny.bench_files) as bench:
        assert resume_run(bench, path).state is State.COMPLETE
    with Record(path) as record:
        images = np.array([record.image(index) for index in range(6)], dtype=float)
        np.testing.assert_allclose(record.column("time"), [one.start_time for one in listed])
    seen = images.mean((1, 2)) - 64.0
    lamp = Waveform("sine", 100.0, 0.6)
    lit = np.array(
        [float(lamp.mean(one.start_time, one.start_time + one.exposure)) for one in listed]
    )
    assert np.ptp(lit) > 0.3
    np.testing.assert_allclose(seen / seen.mean(), lit / lit.mean(), rtol=0.01)


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
            Attendance(on_frame=lambda shot, frame: seen.append(int(bench.world.grey[0, 0]))),
        )
    assert set(seen) == {100}


def test_the_record_logs_what_was_set_and_how_the_run_ended(plan, bench, tmp_path, caplog):
    run_plan(bench, plan, tmp_path / "run.h5")
    with Record(tmp_path / "run.h5") as record:
        texts = [text for _, text in record.log]
        times = [time for time, _ in record.log]
    assert texts[0] == "started: 16 frames to take"
    assert texts[1:4] == ["target: dark", "pattern: neutral", "wavelength: 540 nm"]
    assert texts.count("pattern: lens") == 2
    assert texts[-2] == "all frames taken"
    assert texts[-1] == "expected 0.600 s of bench time, took 0.600 s"
    assert times == sorted(times)


def test_pausing_rests_after_the_frame_and_goes_on_where_it_was(plan, bench, tmp_path):
    """While it rests nothing is taken, the file says PAUSED, and somebody moves the bench."""
    progress, path, taken = Progress(), tmp_path / "run.h5", []
    rested = []

    def pause_at_three(shot, frame):
        taken.append(shot.index)
        if shot.index == 3:
            progress.pause()
            threading.Thread(target=look_and_go_on).start()

    def look_and_go_on():
        while state_of(path) is not State.PAUSED:
            time.sleep(0.05)
        rested.append(list(taken))
        bench.filter.set_wavelength(700e-9)
        progress.resume()

    outcome = run_plan(bench, plan, path, Attendance(progress=progress, on_frame=pause_at_three))
    assert outcome.state is State.COMPLETE
    assert rested == [[0, 1, 2, 3]]
    run_plan(bench, plan, tmp_path / "quiet.h5")
    assert differing_arrays(path, tmp_path / "quiet.h5") == []


def state_of(path) -> State:
    with Record(path) as record:
        return record.state


def test_a_paused_run_can_be_cancelled(plan, bench, tmp_path):
    progress = Progress()

    def rest(shot, frame):
        progress.pause()
        threading.Timer(0.1, progress.cancel).start()

    outcome = run_plan(
        bench, plan, tmp_path / "run.h5", Attendance(progress=progress, on_frame=rest)
    )
    assert (outcome.state, outcome.missing) == (State.CANCELLED, list(range(1, 16)))
    assert is_safe(bench)


def test_a_plan_may_pause_when_a_device_goes_on_failing(plan, bench, tmp_path, monkeypatch):
    broken = threading.Event()
    capture = bench.camera.capture

    def fail_while_broken(cancelled):
        return failing() if broken.is_set() else capture(cancelled)

    def break_it(shot, frame):
        if shot.index == 5:
            broken.set()
            threading.Thread(target=mend).start()

    def mend():
        while not progress.is_paused:
            time.sleep(0.01)
        broken.clear()
        progress.resume()

    progress = Progress()
    monkeypatch.setattr(bench.camera, "capture", fail_while_broken)
    patient = changed(plan, retry={"then": "pause", "wait_s": 0})
    path = tmp_path / "run.h5"
    outcome = run_plan(bench, patient, path, Attendance(progress=progress, on_frame=break_it))
    assert outcome.state is State.COMPLETE
    with Record(path) as record:
        assert any(text.startswith("paused: ") and "Mend it" in text for _, text in record.log)


def test_resuming_takes_the_missing_frames_only(small, plan, tmp_path):
    progress, path, again = Progress(), tmp_path / "run.h5", []
    with open_bench(small.bench_files) as bench:
        run_plan(bench, plan, tmp_path / "whole.h5")
        outcome = run_plan(
            bench,
            plan,
            path,
            Attendance(
                progress=progress,
                on_frame=lambda shot, frame: progress.cancel() if shot.index == 6 else None,
            ),
        )
    assert (outcome.state, outcome.missing) == (State.CANCELLED, list(range(7, 16)))
    with h5py.File(path, "r+") as file:
        file["entry/data/images"][2, 0, 0] ^= 1
    with open_bench(small.bench_files) as bench:
        outcome = resume_run(
            bench, path, Attendance(on_frame=lambda shot, frame: again.append(shot.index))
        )
        assert is_safe(bench)
    assert outcome.state is State.COMPLETE
    assert again == [2, *range(7, 16)]
    assert differing_arrays(tmp_path / "whole.h5", path) == []
    with Record(path) as record:
        assert record.state is State.COMPLETE
        assert any(text == "resumed: 10 frames to take" for _, text in record.log)


def test_resuming_a_whole_record_changes_nothing_in_it(small, plan, tmp_path):
    path = tmp_path / "run.h5"
    with open_bench(small.bench_files) as bench:
        run_plan(bench, plan, path)
        with Record(path) as record:
            before = record.seeded_arrays() | {"t": record.column("timestamp")}
        assert resume_run(bench, path).state is State.COMPLETE
    with Record(path) as record:
        after = record.seeded_arrays() | {"t": record.column("timestamp")}
    assert all(np.array_equal(before[name], after[name]) for name in before)


def test_a_record_is_not_resumed_on_another_bench(small, plan, tmp_path):
    path = tmp_path / "run.h5"
    with open_bench(small.bench_files) as bench:
        run_plan(bench, plan, path)
    small.bench.write_text(small.bench.read_text().replace("f_number = 5.0", "f_number = 8.0"))
    with (
        open_bench(small.bench_files) as bench,
        pytest.raises(UserError, match=r"this bench differs .* Leave --bench out"),
    ):
        resume_run(bench, path)


PROMPTS = {"star": {"prompt": "Place the star at 1.5 m, press Enter."}}


def test_a_person_is_asked_once_before_a_target_and_waited_for(plan, bench, tmp_path):
    asked, frames = [], []

    def ask(text, progress):
        asked.append((text, len(frames), state_of(tmp_path / "run.h5")))

    run_plan(
        bench,
        changed(plan, targets=PROMPTS),
        tmp_path / "run.h5",
        Attendance(ask=ask, on_frame=lambda shot, frame: frames.append(shot.index)),
    )
    assert asked == [("Place the star at 1.5 m, press Enter.", 8, State.PAUSED)]


def test_a_plan_with_prompts_needs_somebody_who_answers(plan, bench, tmp_path):
    with pytest.raises(UserError, match=r"asks a person 1 times, first: 'Place the star"):
        run_plan(bench, changed(plan, targets=PROMPTS), tmp_path / "run.h5")
    assert not (tmp_path / "run.h5").exists()


def test_who_cancels_at_a_prompt_ends_the_run(plan, bench, tmp_path):
    progress = Progress()
    outcome = run_plan(
        bench,
        changed(plan, targets=PROMPTS),
        tmp_path / "run.h5",
        Attendance(progress=progress, ask=lambda text, progress: progress.cancel()),
    )
    assert (outcome.state, outcome.missing) == (State.CANCELLED, list(range(8, 16)))


def test_a_run_that_has_no_room_does_not_begin(plan, bench, tmp_path, monkeypatch):
    monkeypatch.setattr(frame_storage, "free_bytes", lambda path: 100_000)
    with pytest.raises(UserError, match=r"needs \d MB, and its disk has 0 MB free. Make space"):
        run_plan(bench, plan, tmp_path / "run.h5")
    assert list(tmp_path.glob("*.h5")) == []


@pytest.mark.parametrize("where", ["before a frame", "in a frame"])
def test_a_full_disk_pauses_the_run_until_there_is_space(
    small, plan, bench, tmp_path, monkeypatch, where
):
    """In a frame: the disk refuses although it seemed to have room, as a quota does."""
    path, full, messages = tmp_path / "run.h5", threading.Event(), []
    pwrite = os.pwrite

    def refuse(handle, data, offset):
        # The few bytes of state and log have had their place since the beginning.
        if full.is_set() and len(data) > 4000:
            raise OSError(errno.ENOSPC, "No space left on device")
        return pwrite(handle, data, offset)

    def room(path):
        return 0 if full.is_set() else 10**9

    def fill(shot, frame):
        if shot.index == 4:
            full.set()
            if where == "in a frame":
                monkeypatch.setattr(frame_storage, "free_bytes", lambda path: 10**9)
            threading.Thread(target=free).start()

    def free():
        while state_of(path) is not State.PAUSED:
            time.sleep(0.05)
        with Record(path) as record:
            messages.append((record.message, record.missing_frames()))
        full.clear()

    monkeypatch.setattr(os, "pwrite", refuse)
    monkeypatch.setattr(frame_storage, "free_bytes", room)
    outcome = run_plan(bench, plan, path, Attendance(on_frame=fill))
    monkeypatch.undo()
    assert (outcome.state, outcome.missing) == (State.COMPLETE, [])
    message, missing = messages[0]
    assert "is full. Make space" in message
    assert missing == list(range(5, 16))
    run_plan(bench, plan, tmp_path / "quiet.h5")
    assert differing_arrays(path, tmp_path / "quiet.h5") == []


def test_a_disk_that_fails_for_good_ends_the_run(plan, bench, tmp_path, monkeypatch):
    pwrite = os.pwrite

    def break_down(handle, data, offset):
        # The record gets its name before the run begins.
        if len(data) > 4000 and (tmp_path / "run.h5").exists():
            raise OSError(errno.EIO, "Input/output error")
        return pwrite(handle, data, offset)

    monkeypatch.setattr(os, "pwrite", break_down)
    outcome = run_plan(bench, plan, tmp_path / "run.h5")
    assert (outcome.state, outcome.missing) == (State.FAILED, list(range(16)))
    assert "Input/output error" in outcome.message
    assert is_safe(bench)


def test_cancelling_ends_a_long_exposure_at_once(small, plan, tmp_path):
    """The clock runs in real time, and the exposure would last 30 s."""
    long = changed(plan, acquire=[plan.acquire[0].model_dump() | {"exposures_ms": [30000]}])
    progress = Progress()

    def soon_cancelled(cancelled):
        threading.Timer(0.3, progress.cancel).start()
        return capture(cancelled)

    with open_bench(small.bench_files, speed=1.0) as bench:
        capture, bench.camera.capture = bench.camera.capture, soon_cancelled
        outcome = run_plan(bench, long, tmp_path / "run.h5", Attendance(progress=progress))
        assert is_safe(bench)
        # Of the 30 s not even half have passed.
        assert bench.clock.now() < 15
    assert outcome.state is State.CANCELLED
    assert outcome.missing == list(range(8))


def test_a_video_is_exposed_for_whole_periods(small, plan, tmp_path):
    spin = {"kind": "video", "frames": ["neutral", "lens"]}
    patterns = plan.model_dump()["patterns"] | {"spin": spin}
    block = {
        "targets": ["star"],
        "patterns": ["spin", "neutral"],
        "wavelengths_nm": [550],
        "periods": [1, 3],
    }
    with open_bench(small.bench_files) as bench:
        outcome = run_plan(
            bench, changed(plan, patterns=patterns, acquire=[block]), tmp_path / "run.h5"
        )
    assert outcome.state is State.COMPLETE
    with Record(outcome.path) as record:
        np.testing.assert_allclose(
            record.column("exposure"), np.array([2, 6, 2, 6]) / 60, atol=1e-6
        )
        assert record.pattern("spin").shape == (2, 108, 192)


def test_runs_in_a_queue_are_checked_together_and_run_in_turn(small, plan, bench, tmp_path):
    told = []
    requests = [RunRequest(plan, tmp_path / f"{name}.h5", name) for name in "ab"]
    outcomes = run_all(bench, requests, on_outcome=told.append)
    assert [o.state for o in outcomes] == [State.COMPLETE] * 2
    assert told == outcomes
    wrong = changed(plan, acquire=[plan.acquire[0].model_dump() | {"wavelengths_nm": [900]}])
    more = [RunRequest(plan, tmp_path / "c.h5", "c"), RunRequest(wrong, tmp_path / "d.h5", "d")]
    with pytest.raises(UserError, match=r"d: key 'acquire.0.wavelengths_nm' has 900"):
        run_all(bench, more)
    assert not (tmp_path / "c.h5").exists()
    twice = [RunRequest(plan, tmp_path / "e.h5"), RunRequest(plan, tmp_path / "e.h5")]
    with pytest.raises(UserError, match="two runs would write it"):
        run_all(bench, twice)


def test_a_failed_run_does_not_keep_the_next_from_its_turn(plan, bench, tmp_path, monkeypatch):
    capture = bench.camera.capture
    calls = iter(range(1000))

    def fail_thrice(*args):
        return failing() if next(calls) < 3 else capture(*args)

    monkeypatch.setattr(bench.camera, "capture", fail_thrice)
    requests = [RunRequest(plan, tmp_path / f"{name}.h5") for name in "ab"]
    states = [outcome.state for outcome in run_all(bench, requests)]
    assert states == [State.FAILED, State.COMPLETE]


class Noting:
    """A hook that notes when it was called."""

    def __init__(self, notes):
        self.notes = notes

    def before_run(self, shots):
        self.notes.append(f"run {len(shots)}")

    def after_frame(self, shot, frame):
        self.notes.append(f"frame {shot.index} {frame.image.shape}")
        if shot.index == 2:
            raise ValueError("enough")

    def after_run(self, state):
        self.notes.append(state)


def test_a_hook_sees_the_run_and_its_failure_is_named(plan, bench, tmp_path, monkeypatch):
    notes = []

    class Entry:
        name = "noting"

        def load(self):
            return lambda plan, bench: Noting(notes)

    class Entries(list):
        names = ("noting",)

    for module in (hooks, feasibility):
        monkeypatch.setattr(module, "entry_points", lambda group: Entries([Entry()]))
    outcome = run_plan(bench, changed(plan, hooks=["noting"]), tmp_path / "run.h5")
    assert notes == ["run 16", *(f"frame {n} (64, 96)" for n in range(3)), "FAILED"]
    assert outcome.state is State.FAILED
    assert outcome.message == "hook 'noting', after_frame: ValueError: enough"
    assert outcome.missing == list(range(3, 16))


def test_a_hook_that_fails_at_the_end_keeps_a_run_from_being_complete(
    plan, bench, tmp_path, monkeypatch
):
    class Late:
        def after_run(self, state):
            raise ValueError(f"no place for {state}")

    monkeypatch.setattr(hooks.Hooks, "of", lambda plan, bench: hooks.Hooks([("late", Late())]))
    outcome = run_plan(bench, plan, tmp_path / "run.h5")
    assert (outcome.state, outcome.missing) == (State.FAILED, [])
    with Record(outcome.path) as record:
        assert (record.state, record.message) == (State.FAILED, outcome.message)
    assert outcome.message == "hook 'late', after_run: ValueError: no place for COMPLETE"


def test_a_camera_that_sets_quite_another_exposure_is_not_believed(plan, bench, tmp_path):
    """Steps of a line or two are a camera's way; half of what was asked for isn't."""
    set_exposure = bench.camera.set_exposure
    bench.camera.set_exposure = lambda seconds: set_exposure(seconds / 2)
    outcome = run_plan(bench, plan, tmp_path / "run.h5")
    assert (outcome.state, outcome.missing) == (State.FAILED, list(range(16)))
    assert "capture at 0.5 ms: 1 ms were asked for" in outcome.message


def test_a_pattern_that_is_damaged_in_the_record_is_not_shown(small, plan, tmp_path):
    path = tmp_path / "run.h5"
    with open_bench(small.bench_files) as bench:
        run_plan(bench, plan, path)
    with h5py.File(path, "r+") as file:
        file["entry/patterns/images"][1, 0, 0] ^= 1
    with (
        open_bench(small.bench_files) as bench,
        pytest.raises(UserError, match="not as they were shown: lens"),
    ):
        resume_run(bench, path)


def test_what_a_person_takes_is_not_what_the_run_takes(plan, bench, tmp_path):
    def ask(text, progress):
        bench.clock.wait_until(bench.clock.now() + 1000, lambda: False)

    outcome = run_plan(
        bench, changed(plan, targets=PROMPTS), tmp_path / "run.h5", Attendance(ask=ask)
    )
    assert outcome.state is State.COMPLETE
    assert outcome.elapsed_seconds == pytest.approx(outcome.expected_seconds)
