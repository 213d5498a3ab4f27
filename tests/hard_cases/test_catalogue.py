"""Every row of the catalogue is tried at its hardest tolerance, and by sweeps at its others.

Dear rows that ask what cheaper ones ask, at other numbers, are left to sweeps.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from hard_cases.catalogue import CASES, SUBJECTS, listing
from hard_cases.table import Case

SWEPT = {
    # Beside a thousand waves.
    "three thousand waves over a whole blur",
    "the derivative in 3000 waves, an object at 0.5 m",
    "the derivative in 3000 waves, an object at 2 m",
    # Beside a tolerance below rounding, of a lens.
    "no tolerance at all",
    "a chain to a tolerance below rounding",
    # Beside one lit cell in a corner.
    "the far corner of a wide window",
    # Beside cells 3 mm on and half a metre aside, a turned plane and its lengths.
    "cells, 3e-05 m on",
    "cells, -0.0001 m on",
    "cells a metre away, half a metre aside, paraxial",
    "a plane turned by (0.3, -0.7) rad",
    "lengths of a metre's way",
    "lengths of two beams on their way back",
    "power after -1e-06 m of a quarter of a micrometre",
    # Beside two backward passes through a chain, and other chains of the kind.
    "five steps of descent through a chain",
    "a panel 5 cm before its lens, on pixels",
    "an odd panel's chain on an even window",
    "a chain's panel far larger than its stop",
    "a chain's window in the third order",
    "a hexagon behind a chain's panel",
    "exact spheres from far away",
    # Beside a window a thousand rings off the axis, a hexagon's star and a steep plate.
    "a window across the rim of the blur",
    "ten thousand waves, over the whole blur",
    "a hexagon out of focus",
    "coma, astigmatism and defocus",
    # Beside other distances of two beams, and a search out of focus.
    "two beams, -1 m on",
    "a search from a flat pattern, in focus in the middle",
    # Beside a spider that holds an obscuration, and other aberrations.
    "a spider out of focus",
    "in one of three aberrations",
    "sixteen periods around the rim",
    # Beside the same of other methods.
    "units far from 1, L-BFGS-B",
    "units far from 1, plug-and-play",
    "units far from 1, hyper-Laplacian",
    "units far from 1, Poisson total variation",
    "a PSF larger than the picture, plug-and-play",
    "negative data, plug-and-play",
    "constant pictures, Poisson total variation",
    # Beside panels of a row, and windows and patterns of one sample.
    "panel and window of prime sides",
}


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
    if tol != min(case.tols) or case.name in SWEPT:
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
    assert set(names) > SWEPT
    for case in CASES:
        assert all((case.name, case.hard_because, case.asked(), case.judged(), case.tols))
