"""The command line as a shell starts it, libraries and all; other tests fork its processes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from labapp.runs.record.reader import Record
from labapp.runs.state import State


@pytest.mark.parametrize(
    "start", [[Path(sys.executable).with_name("labapp")], [sys.executable, "-m", "labapp"]]
)
def test_the_command_and_the_module_start(start):
    done = subprocess.run([*start, "plan", "list"], capture_output=True, text=True, check=True)
    assert "coded-snapshot" in done.stdout


def test_a_run_loads_what_it_needs_and_warns_of_nothing(small, tmp_path):
    path = tmp_path / "run.h5"
    start = [sys.executable, "-W", "error", "-c", "from labapp.cli import main; main()"]
    words = ["run", str(small.plan), *small.arguments(), "--out", str(path)]
    done = subprocess.run([*start, *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    with Record(path) as record:
        assert record.state is State.COMPLETE
