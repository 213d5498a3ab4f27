"""Runs of a tiny project: what hangs has a name and takes nothing with it, nothing is left."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

PATIENCE = 60.0

HANGING = """
import signal, subprocess, sys, time
import pytest

@pytest.fixture(scope="module")
def shared():
    return object()

def test_before(shared):
    pass

def test_that_hangs(shared):
    with open("began", "a") as file:
        file.write("once ")
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(1000)"],
                             start_new_session=True)
    print("this was", "printed")
    # As where an event loop in a library never gives Python a chance.
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGALRM})
    time.sleep(1000)

def test_that_fails(shared):
    assert 1 + 1 == 3, "a sum"

@pytest.mark.parametrize("number", range(20))
def test_after(number, shared):
    pass
"""

HOLDING = """
import ctypes, signal, time

def test_before():
    time.sleep(0.8)

def test_that_holds_the_interpreter():
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGALRM})
    ctypes.PyDLL(None).sleep(1000)

def test_after():
    pass
"""

OTHERS = """
import pytest

@pytest.mark.parametrize("number", range(20))
def test_other(number):
    pass
"""

LATE = """
import time

def test_that_is_late():
    time.sleep(1000)

def test_after():
    pass
"""

ASLEEP = """
import subprocess, sys, time
from pathlib import Path

def test_asleep():
    subprocess.Popen([sys.executable, "-c", "import time; time.sleep(1000)"],
                     start_new_session=True)
    Path("asleep").touch()
    time.sleep(1000)
"""


SHARING = """
import pytest

@pytest.mark.parametrize("number", range(5))
def test_with_it(number, demo):
    pass
"""

DEMO = """
import os
import pytest

@pytest.fixture(scope="session")
def demo():
    with open("made", "a") as file:
        file.write("once ")
"""


class Project:
    """A folder with tests, and runs of them with the plugin that these tests run under."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (folder / "conftest.py").write_text('pytest_plugins = ["runner.plugin"]\n')
        (folder / "pytest.ini").write_text("[pytest]\ntimeout = 1\ngrace = 1\n")
        self._begun: list[subprocess.Popen[str]] = []

    def add(self, files: dict[str, str]) -> None:
        for name, text in files.items():
            path = self.folder / f"{name}.py"
            path.parent.mkdir(exist_ok=True)
            path.write_text(text)

    def begin(self, *options: str) -> subprocess.Popen[str]:
        own = {"PYTHONPATH": str(Path(__file__).parents[1]), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
        others = {name: v for name, v in os.environ.items() if not name.startswith("PYTEST")}
        plugins = ["-p", "xdist", "-p", "pytest_timeout"]
        process = subprocess.Popen(
            [sys.executable, "-m", "pytest", *plugins, *options],
            cwd=self.folder,
            env=others | own,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            process_group=0,
        )
        self._begun.append(process)
        return process

    def run(self, *options: str) -> str:
        """What it prints."""
        return self.begin(*options).communicate(timeout=PATIENCE)[0]

    def close(self) -> None:
        for process in self._begun:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.communicate(timeout=PATIENCE)


@pytest.fixture
def project(tmp_path):
    made = Project(tmp_path)
    yield made
    made.close()


def wait_for(seen: Callable[[], object]) -> None:
    late = time.monotonic() + PATIENCE
    while not seen():
        assert time.monotonic() < late
        time.sleep(0.01)


def working_in(folder: Path) -> list[Path]:
    """The processes whose working directory this is."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if (process / "cwd").readlink() == folder:
                found.append(process)
    return found


def test_what_hangs_has_a_name_and_the_other_tests_go_on(project):
    project.add({"test_hanging": HANGING, "test_others": OTHERS})
    said = project.run("-n", "2")
    name = "test_hanging.py::test_that_hangs"
    assert f"FAILED {name}: {name} has not ended after 2 s" in said
    assert "this was printed" in said
    assert "in test_that_hangs" in said
    # Said when it was seen, not at the end.
    assert said.index("test_that_fails: AssertionError: a sum") < said.index("[100%]")
    assert "2 failed, 41 passed" in said
    assert (project.folder / "began").read_text() == "once "
    assert working_in(project.folder) == []


def test_what_hangs_has_a_name_without_workers(project):
    project.add({"test_hanging": HANGING})
    said = project.run()
    assert "test_hanging.py::test_that_hangs has not ended after 2 s" in said
    assert "this was printed" in said
    assert working_in(project.folder) == []


@pytest.mark.sweep  # it takes ten seconds of waiting
def test_what_keeps_all_of_python_from_running_has_a_name(project):
    project.add({"test_holding": HOLDING})
    said = project.run("-n", "1")
    assert "FAILED test_holding.py::test_that_holds_the_interpreter: Timeout (0:00:07)!" in said
    assert "1 failed, 2 passed" in said


def test_what_is_late_fails_and_the_process_lives(project):
    project.add({"test_late": LATE})
    said = project.run()
    assert "FAILED test_late.py::test_that_is_late: Failed: Timeout (>1.0s)" in said
    assert "1 failed, 1 passed" in said


def test_what_tests_of_several_files_share_is_made_by_one_worker(project):
    files = {f"tests/test_{number}": SHARING for number in range(3)}
    project.add(files | {"tests/conftest": DEMO})
    assert "15 passed" in project.run("-n", "2")
    assert (project.folder / "made").read_text() == "once "


@pytest.mark.parametrize(
    "wish", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.sweep)]
)
def test_who_stops_a_run_leaves_nothing_running(project, wish):
    project.add({"test_asleep": ASLEEP})
    process = project.begin("-n", "2", "--timeout", "1000")
    wait_for(lambda: (project.folder / "asleep").exists())
    if wish == signal.SIGINT:
        os.killpg(process.pid, wish)  # as a terminal does
    else:
        process.send_signal(wish)
    said, _ = process.communicate(timeout=PATIENCE)
    assert "KeyboardInterrupt" in said
    # One that was told to end may still be on its way out.
    wait_for(lambda: working_in(project.folder) == [])
