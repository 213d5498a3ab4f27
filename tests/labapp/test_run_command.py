"""`labapp run` and `labapp resume`, as a person at a terminal uses them."""

from __future__ import annotations

import json
import os
import pty
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import forked
import pytest
from figures.durability import differing_arrays

from labapp.files.reading import bundled_path
from labapp.runs.record.reader import Record
from labapp.runs.state import State

PROMPT = """
[targets.star]
prompt = "Place the star at 1.5 m, press Enter."
"""

SHORT = "exposures_ms = [1, 8]"
LONG = "exposures_ms = [200, 300]"


def command(*arguments) -> list[str]:
    return [sys.executable, "-m", "labapp", *map(str, arguments)]


def run(small, out, *options) -> list[str]:
    return command("run", small.plan, *small.arguments(), "--out", out, *options)


def change(path: Path, old: str, new: str) -> None:
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))


def wait_until(true) -> None:
    late = time.monotonic() + 60
    while not true():
        assert time.monotonic() < late
        # To open a record takes the processor ten milliseconds.
        time.sleep(0.05)


def state_of(path: Path) -> State | None:
    if not path.exists():
        return None
    with Record(path) as record:
        return record.state


def stored(path: Path) -> int:
    if not path.exists():
        return 0
    with Record(path) as record:
        return int(record.column("stored").sum())


def test_a_killed_run_is_resumed_by_one_command(labapp, small, tmp_path):
    labapp("run", small.plan, *small.arguments(), "--out", tmp_path / "whole.h5")
    path = tmp_path / "run.h5"
    with forked.Popen(run(small, path, "--speed", "0.2")) as process:
        wait_until(lambda: stored(path) >= 2)
        process.send_signal(signal.SIGKILL)
    assert state_of(path) is State.INTERRUPTED
    code, said, errors = labapp("resume", path)
    assert code == 0, errors
    assert "COMPLETE" in said
    assert "frames to take" in errors
    assert differing_arrays(tmp_path / "whole.h5", path) == []
    code, said, errors = labapp("resume", path)
    assert (code, "0 frames to take" in errors) == (0, True)


def test_a_run_that_failed_says_how_to_go_on(labapp, small, tmp_path):
    faults = tmp_path / "faults.toml"
    faults.write_text(
        'version = 1\n[[fault]]\ndevice = "camera"\nkind = "error"\nframe = 5\ntimes = 100\n'
    )
    path = tmp_path / "run.h5"
    code, _, errors = labapp(
        "run", small.plan, *small.arguments(), "--out", path, "--faults", faults
    )
    assert code == 1
    assert "FAILED: simulated camera: expose" in errors
    assert "11 frames are missing (5, 6, 7, 8, 9, 10, 11, 12, ...)" in errors
    assert f"labapp resume {path}" in errors
    code, said, _ = labapp("resume", path, "--json")
    assert code == 0
    outcome = json.loads(said)
    assert (outcome["state"], outcome["missing"]) == ("COMPLETE", [])


def test_faults_need_a_virtual_bench_and_a_right_file(labapp, small, tmp_path):
    faults = tmp_path / "faults.toml"
    faults.write_text('version = 1\n[[fault]]\ndevice = "lamp"\nkind = "error"\n')
    code, _, errors = labapp(
        "run", small.plan, *small.arguments(), "--out", tmp_path / "run.h5", "--faults", faults
    )
    assert code == 1
    assert "fault.0.device" in errors
    assert "'lamp'" in errors
    assert not (tmp_path / "run.h5").exists()


def test_several_plans_run_in_turn_into_a_folder(labapp, small, tmp_path):
    second = small.plan.with_name("second.json")
    import tomllib

    second.write_text(json.dumps(tomllib.loads(small.plan.read_text())))
    folder = tmp_path / "my" / "runs"
    code, said, _ = labapp("run", small.plan, second, *small.arguments(), "--out", folder, "--json")
    assert code == 0
    assert [one["state"] for one in json.loads(said)] == ["COMPLETE"] * 2
    assert {file.name for file in folder.iterdir()} == {"plan.h5", "second.h5"}
    assert differing_arrays(folder / "plan.h5", folder / "second.h5") == []


def test_a_picture_that_has_changed_is_not_resumed_with(labapp, small, tmp_path):
    path = tmp_path / "run.h5"
    labapp("run", small.plan, *small.arguments(), "--out", path)
    picture = small.folder / "picture.png"
    picture.write_bytes(picture.read_bytes()[:-1])
    code, _, errors = labapp("resume", path)
    assert code == 1
    assert f"{picture} is not the picture any more" in errors


def test_another_bench_is_refused_by_name(labapp, small, tmp_path):
    path = tmp_path / "run.h5"
    labapp("run", small.plan, *small.arguments(), "--out", path)
    change(small.bench, "focal_length_mm = 125.0", "focal_length_mm = 100.0")
    code, _, errors = labapp("resume", path, "--bench", small.bench)
    assert (code, "Leave --bench out" in errors) == (1, True)


def test_prompts_are_answered_with_enter(small, tmp_path):
    small.plan.write_text(small.plan.read_text() + PROMPT)
    path = tmp_path / "run.h5"
    with forked.Popen(
        run(small, path), stdin=forked.PIPE, stderr=forked.PIPE, text=True
    ) as process:
        wait_until(lambda: state_of(path) is State.PAUSED)
        assert stored(path) == 8
        _, errors = process.communicate("\n", timeout=60)
    assert process.returncode == 0, errors
    assert "Place the star at 1.5 m, press Enter." in errors
    assert state_of(path) is State.COMPLETE


def test_prompts_with_nobody_there_fail_the_run_in_words(labapp, small, tmp_path):
    small.plan.write_text(small.plan.read_text() + PROMPT)
    path = tmp_path / "run.h5"
    done = forked.run(
        run(small, path), stdin=forked.DEVNULL, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 1
    assert "asks a person, and standard input has ended" in done.stderr
    assert state_of(path) is State.FAILED
    assert labapp("resume", path, "--yes")[0] == 0


@contextmanager
def terminal(arguments, then="pass"):
    """labapp on a terminal of its own, and what writes its keys. then: what it does first."""
    master, slave = pty.openpty()
    # The terminal becomes the process' own, with it in the foreground, as a shell would do.
    own = (
        "import fcntl, os, termios; from labapp.cli import main; "
        f"fcntl.ioctl(0, termios.TIOCSCTTY, 0); {then}; main()"
    )
    python, _, _, *words = arguments
    with forked.Popen(
        [python, "-c", own, *words],
        stdin=slave,
        stdout=slave,
        stderr=slave,
        start_new_session=True,
    ) as process:
        os.close(slave)
        drained = subprocess.Popen(["cat"], stdin=master, stdout=subprocess.DEVNULL)
        try:
            yield process, lambda keys: os.write(master, keys)
        finally:
            process.kill()
            drained.kill()
            drained.wait()
            os.close(master)


def test_keys_pause_a_run_and_let_it_go_on(small, tmp_path):
    change(small.plan, SHORT, LONG)
    path = tmp_path / "run.h5"
    with terminal(run(small, path, "--speed", "1")) as (process, press):
        wait_until(lambda: stored(path) >= 1)
        press(b"p")
        wait_until(lambda: state_of(path) is State.PAUSED)
        taken = stored(path)
        time.sleep(0.5)
        assert stored(path) == taken
        press(b"r")
        wait_until(lambda: stored(path) > taken)
        assert process.wait(60) == 0
    assert state_of(path) is State.COMPLETE


LIT = """
version = 1
title = "Lit darks"
[patterns.neutral]
kind = "constant"
[[acquire]]
targets = ["photograph"]
exposures_ms = [400]
wavelengths_nm = [550]
patterns = ["neutral"]
repeats = 2
role = "dark"
"""


def log_of(path):
    with Record(path) as record:
        return [text for _, text in record.log]


def test_a_doubted_frame_is_taken_again_or_kept_by_a_key(small, tmp_path):
    small.plan.write_text(LIT)
    path = tmp_path / "run.h5"
    with terminal(run(small, path)) as (process, press):
        wait_until(lambda: state_of(path) is State.PAUSED)
        press(b"\n")
        wait_until(lambda: sum("is doubted" in text for text in log_of(path)) == 2)
        assert stored(path) == 0
        press(b"k")
        assert process.wait(60) == 0
    assert state_of(path) is State.COMPLETE
    log = log_of(path)
    assert "taken again" in log
    assert "kept by a person" in log


@pytest.mark.parametrize("options", [(), ("--yes",)])
def test_a_doubted_frame_is_kept_where_nobody_is_asked(small, tmp_path, options):
    small.plan.write_text(LIT)
    path = tmp_path / "run.h5"
    if options:
        with terminal(run(small, path, *options)) as (process, _):
            assert process.wait(60) == 0
    else:
        assert forked.run(run(small, path), stdin=forked.DEVNULL).returncode == 0
    assert any("is doubted" in text for text in log_of(path))


BEHIND = "os.fork() and os._exit(os.waitstatus_to_exitcode(os.wait()[1])); os.setpgid(0, 0)"
"""Leaves the terminal to the parent, as a shell's & does."""


def test_a_run_in_the_background_leaves_the_terminal_alone(small, tmp_path):
    """Who reads from the terminal behind somebody's back is stopped by the system."""
    path = tmp_path / "run.h5"
    with terminal(run(small, path), BEHIND) as (process, press):
        press(b"p")
        assert process.wait(60) == 0
    assert state_of(path) is State.COMPLETE


def test_a_run_does_not_eat_what_others_want_to_read(small, tmp_path):
    """As in a shell's `while read plan; do labapp run ...; done`."""
    python, _, _, *words = run(small, tmp_path / "run.h5")
    script = (
        "import os, sys; from labapp.cli import main\n"
        "if not os.fork(): main(); sys.exit()\n"
        "os.wait(); print(sys.stdin.read())"
    )
    done = forked.run(
        [python, "-c", script, *words], input="stop\nplan\n", capture_output=True, text=True
    )
    assert done.stdout.endswith("stop\nplan\n\n")
    assert state_of(tmp_path / "run.h5") is State.COMPLETE


@pytest.mark.parametrize("wish", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_who_interrupts_a_run_leaves_it_cancelled_and_can_resume_it(labapp, small, tmp_path, wish):
    change(small.plan, SHORT, LONG)
    path = tmp_path / "run.h5"
    with forked.Popen(
        run(small, path, "--speed", "1"), stdin=forked.DEVNULL, stderr=forked.PIPE
    ) as process:
        wait_until(lambda: stored(path) >= 1)
        process.send_signal(wish)
        _, said = process.communicate(timeout=60)
        assert process.returncode == 130
    assert b"cancelled" in said
    assert b"Traceback" not in said
    with Record(path) as record:
        assert record.state is State.CANCELLED
        count = int(record.column("stored").sum())
        assert 0 < count < record.frame_count
        assert record.missing_frames() == list(range(count, record.frame_count))
    assert labapp("resume", path)[0] == 0
    assert state_of(path) is State.COMPLETE


def test_the_bundled_faults_are_survived(labapp, small, tmp_path):
    small.bench.write_text(
        small.bench.read_text().replace(
            'driver = "simulated-camera"',
            'driver = "simulated-camera"\noptions = { reply_s = 0.3 }',
        )
    )
    change(small.plan, SHORT, "exposures_ms = [1, 8]\nrepeats = 2")
    path = tmp_path / "run.h5"
    faults = bundled_path("faults.toml")
    code, _, errors = labapp(
        "run", small.plan, *small.arguments(), "--out", path, "--faults", faults
    )
    assert code == 0, errors
    with Record(path) as record:
        assert [fault["kind"] for fault in record.faults] == [
            "corrupt frame",
            "disconnect",
            "hung",
        ]
        assert (record.column("attempts") > 1).sum() == 3
