"""A test that fails has a name in time, and none after it suffers."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = [pytest.mark.sweep, pytest.mark.timeout(300)]

_HERE = Path(__file__).parent
_LIMIT = 200
"""Seconds of tests that are broken, however busy the machine is."""

_OUTCOME = re.compile(r"^(PASSED|FAILED|ERROR) \S+::(\w+)", re.MULTILINE)


def run(file, names=""):
    """The outcome of each test by its name, and all that pytest says."""
    ours = ("PYTEST_ADDOPTS", "PYTEST_XDIST")
    environment = {name: value for name, value in os.environ.items() if not name.startswith(ours)}
    options = ["-k", names, "-rA", "--tb=short", "-p", "no:cacheprovider", "-o", "addopts="]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", str(_HERE / file), *options],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=_LIMIT,
    )
    return {name: outcome for outcome, name in _OUTCOME.findall(done.stdout)}, done.stdout


def require_named(broken, words, outcomes, said):
    """The broken test failed and says why; the one after it passed."""
    assert outcomes[f"test_{broken}"] in ("FAILED", "ERROR"), said
    assert outcomes[f"test_works_after_{broken}"] == "PASSED", said
    assert all(word in said for word in words), said


def test_tests_that_never_end_are_ended_and_named():
    outcomes, said = run("broken_loops.py")
    late = "the test takes too long"
    for broken, *words in (
        ("a_question", "says 'Is anybody there?', opened by QMessageBox.question("),
        ("a_dialogue", "'QDialog' says 'Say something.', opened by dialogue.exec()"),
        ("a_file", "'Plan to run' says"),
        ("a_python_loop", "in test_a_python_loop", late),
        ("a_sleep", "time.sleep(1e6)", late),
        ("a_lock", "threading.Event().wait()", late),
        ("a_loop_of_qts", "hangs in a loop of Qt's", "QEventLoop().exec()"),
        ("polling", "in test_polling", late),
        ("a_slot", "in slot", late),
        ("a_teardown", "ERROR at teardown of test_a_teardown", late),
    ):
        require_named(broken, words, outcomes, said)
    assert len(outcomes) == 20


@pytest.mark.parametrize(
    ("broken", "words"),
    [
        ("a_failure_in_a_run", ["not seen in 0.5 s: person.waits(", "runs: ['RUNNING']"]),
        ("a_kill", ["not seen in 0.5 s", "engine: none"]),
        ("a_question_in_a_run", ["'labapp' says 'A run is under way. Cancel it and close?"]),
    ],
)
def test_a_broken_window_is_replaced(broken, words):
    outcomes, said = run("broken_windows.py", f"{broken} or works_after_{broken}")
    require_named(broken, words, outcomes, said)


def test_a_window_without_an_engine_is_replaced():
    """The test that left it passed."""
    outcomes, said = run("broken_windows.py", "dead_engine")
    assert list(outcomes.values()) == ["PASSED", "PASSED"], said
