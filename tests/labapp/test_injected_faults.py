"""A call of the system that fails, anywhere in a command: told, and nothing is lost by it.

`make figures ONLY="injected faults"` lets every call of a run fail, and "message faults" every
message to a device in a process of its own.
"""

from __future__ import annotations

import errno
from pathlib import Path

import pytest
from figures.fault_cases import wrong_words
from figures.faulty_calls import CUT, GONE, MESSAGE, STUCK, Fault
from figures.faulty_command import Ended
from figures.injected_faults import draw, faults_of, workshop_in


def test_a_write_that_fails_at_the_end_of_a_run_is_told(tmp_path: Path) -> None:
    """The last four writes close the record, and those of the draft come first."""
    with workshop_in(tmp_path) as workshop:
        case = workshop.run_case
        writes = workshop.run_once(case, Fault("write", 0, 0, False)).calls
        ends = ((writes // 3, errno.EIO), (writes - 3, errno.ENOSPC), (writes, errno.EIO))
        for number, cause in ends:
            found = workshop.judge(case, Fault("write", number, cause, False))
            assert (found.wrong, found.ended.code, found.ended.failed) == ("", 1, 1), found


@pytest.mark.sweep
def test_a_message_that_fails_is_told(tmp_path: Path) -> None:
    """What becomes of a camera's process between two frames takes no frame that was told."""
    with workshop_in(tmp_path, own_process=True) as workshop:
        for cause in (GONE, STUCK, CUT):
            found = workshop.judge(workshop.run_case, Fault(MESSAGE, 167, cause, False))
            assert (found.wrong, found.ended.failed) == ("", 1), found


DRAWN = {"run": 14, "resume": 8, "export ome-tiff": 6, "salvage": 6}
"""Faults by command, of a thousand."""


@pytest.mark.sweep
@pytest.mark.timeout(900)
def test_calls_drawn_by_chance_fail(tmp_path: Path) -> None:
    wrong = []
    with workshop_in(tmp_path) as workshop:
        for case in workshop.cases():
            if case.name in DRAWN:
                faults = draw(faults_of(workshop, case), DRAWN[case.name], seed=1)
                wrong += [one for fault in faults if (one := workshop.judge(case, fault)).wrong]
    assert wrong == []


@pytest.mark.parametrize(
    ("code", "told", "wrong"),
    [
        (None, "", "hung"),
        (-11, "", "signal 11"),
        (3, "Input/output error. Check the disk.", "exit code 3"),
        (0, "Traceback (most recent call last)", "says 'Traceback'"),
        (1, "unexpected OSError. Add --debug, and report it.", "says 'unexpected'"),
        (1, "", "silent"),
        (1, "It failed. Choose another place.", "doesn't say the cause"),
        (1, "Input/output error.", "says no remedy"),
        (1, "Input/output error. Choose another place.", ""),
    ],
)
def test_the_judge_finds_what_must_not_be(code: int | None, told: str, wrong: str) -> None:
    ended = Ended(code, told, "", 1, 1, "write", [])
    found = wrong_words(ended, Fault("write", 1, errno.EIO, False))
    assert found.startswith(wrong)
    assert bool(found) == bool(wrong)
