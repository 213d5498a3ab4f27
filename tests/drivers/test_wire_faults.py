"""Every driver behind a wire, every fault, every command: the figure's trial, fewer moments."""

from __future__ import annotations

import pytest
from figures.fuzz import fuzz
from figures.serial_cases import SERIAL_CASES
from figures.usb_cases import USB_CASES
from figures.wire_faults import kinds, suffer

_OF_VARIANTS = ("delayed", "bit flips")


def trials():
    for case in (*SERIAL_CASES, *USB_CASES):
        for kind in kinds(case):
            if not case.variant or kind in _OF_VARIANTS:
                marks = [pytest.mark.sweep] if case.variant else []
                yield pytest.param(case, kind, id=f"{case.name}-{kind}", marks=marks)


@pytest.mark.parametrize("moments", [1, pytest.param(5, marks=pytest.mark.sweep)])
@pytest.mark.parametrize(("case", "kind"), list(trials()))
def test_truth_or_a_device_error_in_time_and_the_next_command_works(case, kind, moments):
    wrong = [one for one in suffer(case, kind, moments, seed=99) if one.wrong]
    assert not wrong


@pytest.mark.parametrize("seeds", [1, pytest.param(3, marks=pytest.mark.sweep)])
@pytest.mark.parametrize("case", SERIAL_CASES, ids=lambda case: case.name)
def test_changed_answers_are_never_believed(case, seeds):
    changed = 0
    for seed in range(seeds):
        for count, ended in fuzz(case, 1000 + seed):
            changed += count
            assert ended in ("", "DeviceError")
    assert changed > 50
