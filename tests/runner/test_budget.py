"""The budget of all tests: what is too much fails in CI only, and some tests have none."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from runner.budget import Spent, time_a_piece
from runner.costs import Costs

BUSY = """
import subprocess, sys, time
import pytest

BURN = "import time\\nwhile time.process_time() < 0.3: pass"

@pytest.mark.parametrize("number", range(2))
def test_busy(number):
    subprocess.run([sys.executable, "-c", BURN], check=True)

def test_quick():
    pass
"""

INI = """[pytest]
addopts = -q -m "not sweep" -p xdist -p no:cacheprovider
testpaths = .
markers = sweep: more
"""


def run(folder: Path, *options: str, budget: float, ci: bool) -> tuple[int, str]:
    """Its exit status, and what it prints."""
    (folder / "conftest.py").write_text('pytest_plugins = ["runner.plugin"]\n')
    (folder / "pytest.ini").write_text(INI)
    table = f"[tool.labapp-tests]\ncpu_budget = {budget}\n"
    (folder / "pyproject.toml").write_text(table)
    (folder / "test_busy.py").write_text(BUSY)
    own = {"PYTHONPATH": str(Path(__file__).parents[1]), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    names = [name for name in os.environ if name.startswith("PYTEST") or name == "CI"]
    rest = {name: value for name, value in os.environ.items() if name not in names}
    ended = subprocess.run(
        [sys.executable, "-m", "pytest", *options, "-p", "pytest_timeout"],
        cwd=folder, env=rest | own | ({"CI": "1"} if ci else {}), capture_output=True, text=True,
        timeout=100,
    )  # fmt: skip
    return ended.returncode, ended.stdout + ended.stderr


@pytest.mark.parametrize("workers", [("-n", "2"), pytest.param((), marks=pytest.mark.sweep)])
def test_too_much_fails_in_ci_only_and_says_what_is_dearest(tmp_path, workers):
    status, said = run(tmp_path, *workers, budget=0.5, ci=True)
    assert status == 1
    assert "3 passed" in said
    assert "make the dearest tests cheaper" in said
    # Both children of the function's cases are its own.
    dearest = said.split("The 2 dearest of 2 functions")[1].splitlines()[1].split()
    assert dearest[2] == "test_busy.py::test_busy"
    assert float(dearest[0]) >= 0.6
    assert float(said.split(" s of processor time in all")[0].split()[-1]) >= 1


def test_elsewhere_it_is_only_said(tmp_path):
    status, said = run(tmp_path, budget=0.5, ci=False)
    assert status == 0
    assert "make the dearest tests cheaper" in said


@pytest.mark.sweep
def test_what_keeps_to_it_passes(tmp_path):
    status, said = run(tmp_path, budget=1e6, ci=True)
    assert status == 0
    assert "of processor time in all; " in said
    assert "cheaper" not in said


@pytest.mark.parametrize(
    "options", [["-k", "quick"], pytest.param(["test_busy.py"], marks=pytest.mark.sweep)]
)
def test_some_tests_have_no_budget(tmp_path, options):
    status, said = run(tmp_path, *options, budget=0.01, ci=True)
    assert status == 0
    assert "in all" not in said


def test_a_slower_machine_is_allowed_more():
    assert Spent(1500.0, 1000.0, 1.0).is_too_much
    assert not Spent(1500.0, 1000.0, 2.0).is_too_much
    assert "2000 s are allowed (1000 s in pyproject.toml, times 2.00" in str(
        Spent(1500.0, 1000.0, 2.0).in_words()
    )


def test_the_calibration_is_the_same_work_each_time():
    first, second = (min(time_a_piece() for _ in range(2)) for _ in range(2))
    assert first == pytest.approx(second, rel=0.5)


def test_cases_of_a_function_are_summed():
    costs = Costs()
    for name, cpu in (("a.py::one[1]", 2.0), ("a.py::one[2]", 3.0), ("a.py::two", 4.0)):
        report = pytest.TestReport(
            name, ("a.py", 1, name), {}, "passed", None, "teardown",
            user_properties=[("cpu_seconds", cpu)], duration=cpu,
        )  # fmt: skip
        costs.add(report)
    rows = [line.split() for line in costs.table(1)[2:]]
    assert rows == [["5.0", "5.0", "a.py::one"]]
