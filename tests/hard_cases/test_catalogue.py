"""Every row of the catalogue is tried at its hardest tolerance, and by sweeps at its others."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from hard_cases.catalogue import CASES, SUBJECTS, listing
from hard_cases.table import Case


def rows() -> list[Any]:
    return [
        pytest.param(
            case,
            tol,
            id=case.name if len(case.tols) == 1 else f"{case.name}, tol {tol:g}",
            marks=list(marks(case, tol)),
        )
        for case in CASES
        for tol in case.tols
    ]


def marks(case: Case, tol: float) -> Iterator[pytest.MarkDecorator]:
    if tol != min(case.tols):
        yield pytest.mark.sweep
    if case.fails(tol):
        yield pytest.mark.xfail(reason=case.bug, strict=True)


@pytest.mark.parametrize(("case", "tol"), rows())
def test_a_hard_case(case: Case, tol: float) -> None:
    case.check(tol)


def test_the_catalogue_reads_as_a_table() -> None:
    """One line a case, with all of its cells; no name twice."""
    lines = [line for line in listing().splitlines() if line.startswith("| ")]
    assert len(lines) == len(CASES) + len(SUBJECTS)
    assert all(len(line.replace("\\|", "").split("|")) == 7 for line in lines)
    names = [case.name for case in CASES]
    assert len(set(names)) == len(names)
    for case in CASES:
        assert all((case.name, case.hard_because, case.asked(), case.judged(), case.tols))
