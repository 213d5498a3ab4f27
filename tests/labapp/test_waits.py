"""What waits for a person says so at once, and ends in time where nobody comes."""

from __future__ import annotations

import math
import os
import pty
import signal
import time
from pathlib import Path

import forked
import pytest
from figures.where import ENVIRONMENT, ROOT
from small_bench.files import SmallFiles

from labapp.bench.opening import open_bench
from labapp.common import console
from labapp.files.plan_file import PlanFile
from labapp.files.reading import read_file
from labapp.runs.acquisition import frame_storage
from labapp.runs.acquisition.attendance import Attendance
from labapp.runs.acquisition.runner import run_plan
from labapp.runs.record.reader import Record
from labapp.runs.state import State
from optics.progress import Progress

PROMPT = """
[targets.star]
prompt = "Place the star."
"""


def log_of(path: Path) -> str:
    with Record(path) as record:
        return "\n".join(text for _, text in record.log)


@pytest.fixture
def failing(tiny: SmallFiles, tmp_path: Path) -> SmallFiles:
    """A plan that pauses at its sixth frame, where the camera fails 3 times."""
    (tmp_path / "faults.toml").write_text(
        'version = 1\n[[fault]]\ndevice = "camera"\nkind = "error"\nframe = 5\ntimes = 3\n'
    )
    tiny.plan.write_text(tiny.plan.read_text() + '[retry]\nthen = "pause"\nwait_s = 0\n')
    return tiny


def test_a_full_disk_is_told_at_once_and_ends_the_run_in_time(labapp, tiny, tmp_path, monkeypatch):
    path, again = tmp_path / "run.h5", tmp_path / "again"
    with monkeypatch.context() as full:
        # The plan's space is there before the run, and gone after it has begun.
        full.setattr(frame_storage.FrameStore, "_has_space", lambda store: False)
        words = ("run", tiny.plan, *tiny.arguments(), "--wait-limit", "0.2")
        code, _, said = labapp(*words, "--out", path)
        assert code == 75
        told, ended = said.split("FAILED")
        assert "is full. Make space: the run goes on by itself" in told
        assert "it ends in 0.2 s (--wait-limit)" in told
        assert "waited for 0.2 s" in ended
        assert f"labapp resume {path}" in ended
        assert "is full" in log_of(path)
        # The next plan would wait as long.
        other = tiny.plan.with_name("other.toml")
        other.write_text(tiny.plan.read_text())
        code, _, said = labapp("run", tiny.plan, other, *words[2:], "--out", again)
    assert code == 75
    assert "1 of 2 runs aren't COMPLETE; not begun:" in said
    assert [one.name for one in again.iterdir()] == ["plan.h5"]
    assert labapp("resume", path)[0] == 0


def test_a_failed_device_pauses_until_somebody_comes_or_the_time_is_over(labapp, failing, tmp_path):
    path, faults = tmp_path / "run.h5", tmp_path / "faults.toml"
    words = ["run", failing.plan, *failing.arguments(), "--faults", faults, "--out", path]
    code, _, said = labapp(*words, "--wait-limit", "0.1")
    assert code == 75
    assert "Mend it, then let the run go on" in said
    assert f"kill -USR1 {os.getpid()} goes on" in said
    assert labapp("resume", path)[0] == 0


def test_a_signal_lets_a_run_go_on_where_there_is_no_terminal(failing, tmp_path):
    path, faults = tmp_path / "run.h5", tmp_path / "faults.toml"
    words = ["run", failing.plan, *failing.arguments(), "--faults", faults, "--out", path]
    with forked.Popen(
        [os.sys.executable, "-m", "labapp", *map(str, words)],
        stdin=forked.DEVNULL,
        stderr=forked.PIPE,
        text=True,
        cwd=ROOT,
        env=ENVIRONMENT,
    ) as process:
        assert "PAUSED: simulated camera" in process.stderr.readline()
        process.send_signal(signal.SIGUSR1)
        _, said = process.communicate(timeout=60)
    assert (process.returncode, "the run goes on" in said) == (0, True)


def test_a_question_is_not_asked_for_ever(labapp, tiny, tmp_path, monkeypatch):
    tiny.plan.write_text(tiny.plan.read_text() + PROMPT)
    path, (read, write) = tmp_path / "run.h5", os.pipe()
    with open(read) as silent, open(write, "w"), monkeypatch.context() as patch:
        patch.setattr("sys.stdin", silent)
        words = ["run", tiny.plan, *tiny.arguments(), "--out", path, "--wait-limit", "0.1"]
        code, _, said = labapp(*words)
    assert (code, "nobody has answered within 0.1 s (--wait-limit): Place the star." in said) == (
        75,
        True,
    )
    with Record(path) as record:
        assert record.state is State.FAILED
    assert labapp("resume", path, "--yes")[0] == 0


def test_without_a_terminal_nothing_waits_without_end(monkeypatch):
    ours, theirs = pty.openpty()
    with open(ours, closefd=True), open(theirs) as terminal, open(os.devnull) as nothing:
        for source, limit in ((nothing, 3600.0), (terminal, math.inf)):
            monkeypatch.setattr("sys.stdin", source)
            with console.terminal_progress() as progress:
                assert progress.wait_limit == progress.part(0, 1).wait_limit == limit
    with console.terminal_progress(5.0) as progress:
        assert progress.wait_limit == 5.0


def test_a_pause_by_the_user_has_no_limit(tiny, tmp_path):
    """Who pauses a run is there to let it go on."""
    told = []

    def tell(message: str) -> None:
        told.append(message)
        if message.startswith("PAUSED"):
            time.sleep(0.02)
            progress.resume()

    progress = Progress(teller=tell, wait_limit=0.0)
    progress.pause()
    with open_bench(tiny.bench_files) as bench:
        plan = read_file(tiny.plan, PlanFile)
        outcome = run_plan(bench, plan, tmp_path / "run.h5", Attendance(progress=progress))
    assert outcome.state is State.COMPLETE
    assert told == ["PAUSED: paused by the user", "the run goes on"]
