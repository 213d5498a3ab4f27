"""Other libraries on the same PSF, at equal error, in one run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from labapp_peers.psf import candidates as peer_candidates

from figures import Figure
from labapp.accuracy.psf import candidates, exact_psf
from labapp.accuracy.work_precision import Row, measure
from labapp.common.speed import machine_speed
from labapp.prediction.lens_options import LensCase
from optics.accuracy import Budget
from optics.camera import Lens
from optics.plane import Plane
from optics.progress import Progress
from optics.threads import single_threaded

_CASE = LensCase(Lens(0.1, 5.6, math.inf), 2.0, 520e-9, Plane((256, 256), (3.45e-6, 3.45e-6)))

_WRONG = 0.5
"""A picture further than this from the truth is none to be compared with."""


@single_threaded
def against_peers(folder: Path) -> list[Figure]:
    """Each library's every setting against our fastest that is at least as accurate."""
    found = candidates(_CASE, Budget(speed=machine_speed()))
    ours = [one for one in found if one.row.tol is not None and not one.calls]
    measured = measure([*ours, *peer_candidates(_CASE)], exact_psf(_CASE, Progress()), Progress())
    words, met = told_ratios(measured.rows[: len(ours)], measured.rows[len(ours) :])
    return [
        Figure(
            "other libraries' time over ours for the same PSF at equal error",
            "> 1 at every setting",
            words,
            met,
        )
    ]


def told_ratios(
    ours: Sequence[Row], theirs: Sequence[Row], alike: float = 1.0
) -> tuple[str, bool | None]:
    """Each library's time over that of our fastest row at its error, in words, and whether it
    is above one everywhere; None if no library was measured.

    alike: how much larger than a library's error ours may be and still be called equal.
    """
    own = [row for row in ours if row.tol is not None and not row.failure]
    ratios: dict[str, list[float]] = {}
    missing = []
    for row in theirs:
        library = row.method.split(",")[0]
        if row.failure:
            missing.append(library)
        elif row.error_achieved is not None and row.error_achieved < _WRONG:
            ratios.setdefault(library, []).append(_ratio(row, own, alike))
    told = [f"{library} {min(found):.2g} to {max(found):.2g}" for library, found in ratios.items()]
    told += [f"{library} failed" for library in dict.fromkeys(missing) if library not in ratios]
    return "; ".join(told), all(min(found) > 1 for found in ratios.values()) if ratios else None


def _ratio(row: Row, own: list[Row], alike: float) -> float:
    """A library's time over that of our fastest row that is no less accurate."""
    error = alike * (row.error_achieved or 0.0)
    times = [one.cpu_s or math.inf for one in own if (one.error_achieved or 0.0) <= error]
    return (row.cpu_s or 0.0) / min(times)


MEASUREMENTS = {"peers": against_peers}
