"""Tests that fail in every way that could hold up those after them, and one that looks on.

They aren't collected: test_window_failures.py runs them, in a process of their own.
"""

import os
import signal

import pytest
from plan_files import LONG, write_plan


@pytest.fixture
def works(bench, person):
    """What the test after a broken one sees: a fresh window that follows."""

    def look():
        assert bench.states == []
        person.types(bench.window.settings.exposure, "50")
        person.waits(lambda: bench.frame.exposure == 0.05)

    return look


def test_a_failure_in_a_run(bench, person, chosen_file, tmp_path):
    chosen_file(write_plan(tmp_path, "Too long", repeats=LONG))
    bench.window.actions_["plan"].trigger()
    person.waits(lambda: bench.stored > 2)
    person.waits(lambda: bench.states == ["ELSEWHERE"], patience=0.5)


def test_works_after_a_failure_in_a_run(works):
    works()


def test_a_kill(bench, person):
    os.kill(bench.connection.process_id, signal.SIGKILL)
    person.waits(lambda: bench.frame is None, patience=0.5)


def test_works_after_a_kill(works):
    works()


def test_a_dead_engine(bench, person):
    os.kill(bench.connection.process_id, signal.SIGKILL)
    person.waits(lambda: bench.window.message.is_error)


def test_works_after_a_dead_engine(works):
    works()


def test_a_question_in_a_run(bench, person, chosen_file, tmp_path):
    chosen_file(write_plan(tmp_path, "Too long", repeats=LONG))
    bench.window.actions_["plan"].trigger()
    person.waits(lambda: bench.stored > 2)
    bench.window.close()


def test_works_after_a_question_in_a_run(works):
    works()
