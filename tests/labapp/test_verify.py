"""Verifying: a good record passes, and every damage is named, however bad it is."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace

import h5py
import numpy as np
import pytest
from eight_frames import copy_edited
from small_bench.setups import small_setup

from drivers.hosted import child_process
from labapp.bench.opening import open_bench
from labapp.common.errors import UserError
from labapp.files.plan_file import PlanFile
from labapp.files.reading import read_file
from labapp.runs.acquisition.attendance import Attendance
from labapp.runs.acquisition.runner import resume_run, run_plan
from labapp.runs.record.checks import _min_rising_sequences, check_record
from labapp.runs.record.reader import Record
from labapp.runs.record.verification import Verification
from labapp.runs.state import State
from labapp.runs.verifying import verify
from optics.progress import Cancelled, Progress
from simulator.faults import Fault

PLAN = PlanFile.model_validate(
    {
        "version": 1,
        "title": "Twelve frames",
        "patterns": {
            "neutral": {"kind": "constant"},
            "lens": {"kind": "lens", "focal_length_m": 50.0},
        },
        "acquire": [
            {
                "targets": ["dark", "star"],
                "patterns": ["neutral", "lens"],
                "wavelengths_nm": [550],
                "exposures_ms": [1, 2, 4],
            }
        ],
    }
)

SETUP = small_setup((16, 24))


@pytest.fixture(scope="module")
def good(tmp_path_factory) -> bytes:
    """A record of 12 frames, taken without trouble."""
    path = tmp_path_factory.mktemp("good") / "run.h5"
    with open_bench(SETUP) as bench:
        assert run_plan(bench, PLAN, path).state is State.COMPLETE
    return path.read_bytes()


@pytest.fixture
def run(good, tmp_path):
    path = tmp_path / "run.h5"
    path.write_bytes(good)
    return path


def cancelled_after(path, frames: int) -> None:
    progress = Progress()

    def stop(shot, frame):
        if shot.index == frames - 1:
            progress.cancel()

    with open_bench(SETUP) as bench:
        run_plan(bench, PLAN, path, Attendance(progress=progress, on_frame=stop))


def resumed(path) -> State:
    with open_bench(SETUP) as bench:
        return resume_run(bench, path).state


def results(found: Verification) -> dict[str, str]:
    return {one.check: one.result for one in found.findings}


def detail(found: Verification, check: str) -> str:
    return next(one.detail for one in found.findings if one.check == check)


@pytest.fixture
def checked_here(monkeypatch):
    """`labapp verify` makes its checks in this process, which takes no time to begin."""
    monkeypatch.setattr("labapp.runs.verifying.verify", check_record)


def test_a_good_record_is_in_order(labapp, run, checked_here):
    code, printed, _ = labapp("verify", run, "--json")
    data = json.loads(printed)
    assert (code, data["is_well"], data["go_on"], data["state"]) == (0, True, None, "COMPLETE")
    assert {one["result"] for one in data["checks"]} == {"ok"}
    assert len(data["checks"]) == 15


def test_a_person_reads_a_table_and_a_verdict(labapp, tmp_path, checked_here):
    path = tmp_path / "run.h5"
    cancelled_after(path, 5)
    code, printed, _ = labapp("verify", path)
    assert code == 1
    lines = [line.strip() for line in printed.splitlines()]
    assert [line.split()[:2] for line in lines if line.startswith(("frames", "state"))] == [
        ["frames", "unfinished"],
        ["state", "unfinished"],
    ]
    assert lines[-1].endswith(f"To go on: labapp resume {path}")


def test_the_progress_ends_where_the_work_does(run):
    """Told by the process in which the checks are made."""
    told = []
    assert verify(run, Progress(lambda share, text: told.append((share, text)))).is_in_order
    shares = [share for share, _ in told]
    assert shares == sorted(shares)
    assert told[-1] == (1.0, "check scene pictures")
    assert "read frame 11 back" in [text for _, text in told]


def flip(file):
    file["entry/data/images"][7, 3, 4] ^= 1


def set_column(name, index, value):
    def change(file):
        file[f"entry/data/{name}"][index] = value

    return change


def forget(name):
    def change(file):
        del file[name]

    return change


def write(name, value):
    def change(file):
        old = file[f"entry/{name}"]
        if old.shape:
            old[0] = value
        else:
            del file[f"entry/{name}"]
            file[f"entry/{name}"] = value

    return change


def alter_pattern(file):
    file["entry/patterns/images"][1, 5, 5] ^= 1


def swap_times(file):
    times = file["entry/data/time"]
    times[3], times[4] = times[4], times[3]


def begin_early(frame):
    """An exposure before the last one has ended, though later than that has begun."""

    def change(file):
        times, exposures = file["entry/data/time"], file["entry/data/exposure"]
        times[frame] = times[frame - 1] + 0.5 * exposures[frame - 1]

    return change


def shorten(file):
    del file["entry/data/gain"]
    file["entry/data/gain"] = np.ones(11)


def bend_axis(file):
    file["entry/data/x"][3] *= 2


@pytest.mark.parametrize(
    ("change", "check", "words"),
    [
        (flip, "checksums", "1 frames don't read back: 7"),
        (set_column("checksum", 5, 1), "checksums", "1 frames don't read back: 5"),
        (set_column("stored", slice(2, 4), 0), "frames", "2 of 12 were never stored: 2-3"),
        (set_column("stored", 2, 0), "state", "COMPLETE, and yet 1 frames are missing"),
        (alter_pattern, "patterns", "not as they were shown: lens"),
        (set_column("exposure", 4, 0.0025), "settings", "exposure of frames 4: 2.5 instead of 2"),
        (set_column("exposure", 4, 0.00205), "settings", "exposure of frames 4"),
        (set_column("exposure", 4, np.nan), "settings", "exposure of frames 4: nan"),
        (set_column("wavelength", 4, 551e-9), "settings", "wavelength of frames 4: 551 instead"),
        (set_column("gain", 4, 0), "settings", "no gain: of frames 4"),
        (swap_times, "camera", "time runs backwards"),
        (begin_early(1), "camera", "exposures begin before the last one has ended"),
        (begin_early(6), "camera", "exposures begin before the last one has ended"),
        (begin_early(11), "camera", "exposures begin before the last one has ended"),
        (set_column("time", 3, np.nan), "camera", "no time: of frames 3"),
        (set_column("time", 3, -1.0), "camera", "no time: of frames 3"),
        (set_column("timestamp", 3, 0), "camera", "no timestamp: of frames 3"),
        (set_column("attempts", 3, 0), "camera", "no attempts: of frames 3"),
        (set_column("number", 3, 1), "camera", "counts backwards"),
        (set_column("target", 3, 9), "plan", "no such target: of frames 3"),
        (set_column("role", 3, 200), "plan", "no such role: of frames 3"),
        (set_column("frame", 3, 200), "plan", "aren't numbered"),
        (set_column("wavelength_asked", 3, 0), "plan", "no wavelength_asked: of frames 3"),
        (write("state", b""), "state", "entry/state is missing or can't be read"),
        (write("state", b"DONE"), "state", "entry/state is missing or can't be read"),
        (write("end_time", b"x"), "state", "can't be checked"),
        (write("plan", "{"), "contents", "entry/plan is missing or can't be read"),
        (write("plan", '{"version": 1}'), "contents", "'title' is missing"),
        (write("versions", "{}"), "contents", "can't be checked: KeyError"),
        (shorten, "contents", "of the wrong type or length: gain"),
        (bend_axis, "contents", "aren't even"),
        (forget("entry/data/time"), "contents", "entry/data/time is missing"),
        (forget("entry/data/time"), "camera", "entry/data/time is missing"),
        (forget("entry/data/images"), "contents", "entry/data/images is missing"),
        (forget("entry/data/stored"), "frames", "entry/data/stored is missing"),
        (forget("entry/patterns/sha256"), "patterns", "entry/patterns/sha256 is missing"),
        (forget("entry/patterns"), "patterns", "entry/patterns/"),
        (forget("entry/log"), "camera", "entry/log is missing"),
        (forget("entry/instrument"), "contents", "entry/instrument is missing"),
        (forget("entry"), "file", "is cut short"),
    ],
)
def test_every_mistake_is_named(run, change, check, words):
    with h5py.File(run, "r+") as file:
        change(file)
    found = check_record(run)
    assert not found.is_in_order
    assert check in found.failed_checks
    assert words in detail(found, check)
    assert words in found.verdict or check in found.verdict


def test_what_can_be_taken_again_can_be_resumed(run):
    with h5py.File(run, "r+") as file:
        flip(file)
        file["entry/data/stored"][2] = 0
    found = check_record(run)
    assert (found.damaged, found.not_stored) == ([7], [2])
    assert found.verdict.endswith(f"To take again what is missing: labapp resume {run}")
    assert resumed(run) is State.COMPLETE
    assert check_record(run).is_in_order


def test_what_resuming_cannot_mend_is_said(run):
    with h5py.File(run, "r+") as file:
        alter_pattern(file)
    found = check_record(run)
    assert found.resume_command is None
    assert "Restore it from a copy" in found.verdict


def test_an_unfinished_record_is_unfinished_until_it_is_resumed(tmp_path):
    path = tmp_path / "my run.h5"
    cancelled_after(path, 5)
    found = check_record(path)
    assert found.resume_command == f"labapp resume '{path}'"
    assert found.not_stored == list(range(5, 12))
    left = {check: result for check, result in results(found).items() if result != "ok"}
    assert left == {"frames": "unfinished", "state": "unfinished"}
    assert "unfinished; what is there is in order" in found.verdict
    assert resumed(path) is State.COMPLETE
    assert check_record(path).is_in_order


def test_frames_of_several_sittings_are_in_order(run):
    """The first frames are taken last, by a camera that counts from 1 again."""
    for frames in ([0, 1, 6], [0, 11]):
        with h5py.File(run, "r+") as file:
            file["entry/data/stored"][frames] = 0
        copy_edited(run)
        assert resumed(run) is State.COMPLETE
    found = check_record(run)
    assert found.is_in_order
    assert "2 resumptions" in detail(found, "camera")


def test_a_camera_that_was_opened_again_counts_anew(tmp_path):
    path = tmp_path / "run.h5"
    fault = Fault("camera", "disconnect", frame=5, seconds=0.1)
    with open_bench(replace(SETUP, faults=(fault,))) as bench:
        run_plan(bench, PLAN, path)
    with Record(path) as record:
        assert max(record.column("attempts")) > 1
        numbers = record.column("number").tolist()
    assert numbers != sorted(numbers)
    assert check_record(path).is_in_order


def test_a_writer_that_is_gone_is_named(run):
    with h5py.File(run, "r+") as file:
        file["entry/state"][0] = b"RUNNING"
        gone = json.loads(file["entry/writer"][0]) | {"start": "1"}
        file["entry/writer"][0] = json.dumps(gone).encode()
    found = check_record(run)
    assert results(found)["state"] == "unfinished"
    assert f"process {os.getpid()}" in detail(found, "state")
    assert found.resume_command == f"labapp resume {run}"


@pytest.mark.parametrize("host", [None, "elsewhere"])
def test_a_record_that_is_being_written_is_left_alone(run, host):
    with h5py.File(run, "r+") as file:
        file["entry/state"][0] = b"PAUSED"
        file["entry/digests/closing"][0] = 0
        if host:
            other = json.loads(file["entry/writer"][0]) | {"host": host}
            file["entry/writer"][0] = json.dumps(other).encode()
    found = check_record(run)
    assert results(found)["state"] == "unfinished"
    assert (host or f"process {os.getpid()}") in detail(found, "state")
    assert found.resume_command is None
    assert "still PAUSED" in found.verdict


@pytest.mark.parametrize("what", ["gone", "changed"])
def test_pictures_that_are_gone_are_worth_a_note(small, tmp_path, what):
    path = tmp_path / "run.h5"
    plan = read_file(small.plan, PlanFile)
    with open_bench(small.bench_files) as bench:
        run_plan(bench, plan, path)
    picture = small.folder / "picture.png"
    if what == "gone":
        picture.unlink()
    else:
        picture.write_bytes(b"another")
    found = check_record(path)
    assert found.is_in_order
    assert results(found)["scene pictures"] == "note"
    assert f"{what}: {picture}" in detail(found, "scene pictures")
    with h5py.File(path, "r+") as file:
        file["entry/state"][0] = b"CANCELLED"
    assert results(check_record(path))["scene pictures"] == "unfinished"


@pytest.mark.parametrize("share", [0.0001, 0.01, 0.1, 0.5, 0.9, 0.999, -1])
def test_a_file_that_is_cut_short_is_no_record(run, good, share):
    there = int(share * len(good)) if share > 0 else len(good) - 1
    run.write_bytes(good[:there])
    found = check_record(run)
    assert results(found) == {"file": "WRONG"}
    assert f"{there} of {len(good)} bytes" in found.verdict or "HDF5" in found.verdict
    with pytest.raises(UserError, match=r"run\.h5: is (cut short|not an HDF5|damaged)"):
        Record(run)


@pytest.mark.parametrize(
    "content",
    [b"", b"x", b"no record at all" * 1000, bytes(5000), b"\x89HDF\r\n\x1a\n" + bytes(5000)],
)
def test_garbage_is_no_record(labapp, run, content):
    run.write_bytes(content)
    found = check_record(run)
    assert results(found) == {"file": "WRONG"}
    assert "HDF5" in found.verdict


def test_a_garbage_file_ends_in_a_verdict(labapp, run, checked_here):
    run.write_bytes(b"no record at all")
    code, printed, error = labapp("verify", run)
    assert (code, error) == (1, "")
    assert "NOT IN ORDER: it is not an HDF5 file" in printed


@pytest.mark.parametrize(
    ("first", "size"),
    [
        (48, 200),
        pytest.param(0, 48, marks=pytest.mark.sweep),
        pytest.param(8, 40, marks=pytest.mark.sweep),
    ],
)
def test_zeros_where_the_structure_was_are_found(run, good, first, size):
    run.write_bytes(good[:first] + bytes(size) + good[first + size :])
    found = verify(run, timeout=20)
    assert not found.is_in_order
    assert found.resume_command is None


@pytest.mark.parametrize("places", [10, pytest.param(60, marks=pytest.mark.sweep)])
def test_zeros_and_noise_anywhere_end_in_a_verdict(run, good, places):
    """In the structure or in the data, everything is either harmless or said."""
    rng = np.random.default_rng(1)
    with h5py.File(run, "r") as file:
        # Before it are texts, in which HDF5 may get lost: that is for another test.
        start = file["entry/log"].id.get_offset()
    for _ in range(places):
        first, size = int(rng.integers(start, len(good))), int(rng.choice([4, 64, 1024]))
        noise = rng.bytes(size) if rng.random() < 0.5 else bytes(size)
        run.write_bytes((good[:first] + noise + good[first + size :])[: len(good)])
        found = check_record(run)
        assert found.verdict
        json.dumps([one.detail for one in found.findings])


def lost(path) -> None:
    """A file whose texts HDF5 searches for ever."""
    with h5py.File(path, "w") as file:
        file.attrs["labapp_format"] = 2
        file["entry/title"] = "Test" * 50
    data = path.read_bytes()
    heap = data.find(b"GCOL") + 16
    path.write_bytes(data[:heap] + bytes(512) + data[heap + 512 :])


def test_a_file_in_which_hdf5_is_lost_ends_in_a_verdict(tmp_path):
    path = tmp_path / "run.h5"
    lost(path)
    found = verify(path, timeout=2)
    assert not found.is_in_order
    assert "Restore it from a copy" in found.verdict


def test_whoever_cancels_need_not_wait_for_hdf5(tmp_path):
    """It would be waited for longer than any test may take."""
    path = tmp_path / "run.h5"
    lost(path)

    def listener(share, text):
        if text == "check contents":
            progress.cancel()

    progress = Progress(listener)
    with pytest.raises(Cancelled):
        verify(path, progress, timeout=1000)


def test_a_verification_that_fails_by_itself_is_no_damage(run, monkeypatch):
    monkeypatch.setattr(child_process, "subprocess", subprocess)
    monkeypatch.setattr(sys, "executable", "/bin/false")
    with pytest.raises(RuntimeError, match=r"checks of .* failed"):
        verify(run)


def test_a_file_that_is_not_there_is_a_mistake(labapp, tmp_path):
    code, printed, error = labapp("verify", tmp_path / "run.h5")
    assert (code, printed) == (1, "")
    assert "there is no such file" in error


def test_a_damaged_record_is_a_line_for_every_command(labapp, run, good):
    run.write_bytes(good[: len(good) * 3 // 4])
    for command in (["show", run], ["report", run], ["export", run, "--to", "png", "--out", "o"]):
        code, _, error = labapp(*command)
        assert code == 1
        assert "is cut short" in error


def test_rows_that_rise_are_counted():
    assert _min_rising_sequences([]) == 0
    assert _min_rising_sequences([1, 2, 3]) == 1
    assert _min_rising_sequences([1, 2, 2]) == 2
    assert _min_rising_sequences([5, 1, 6, 2, 7, 3]) == 2
    assert _min_rising_sequences([3, 2, 1]) == 3


def test_the_checks_load_only_in_their_own_process():
    code = "import sys, labapp.runs.verifying; print('h5py' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
