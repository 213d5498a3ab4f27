"""Other libraries on the same way through free space, at equal error, in one run."""

from __future__ import annotations

from pathlib import Path

from labapp_peers.free_space import candidates as peer_candidates

from figures import Figure
from figures.peers import told_ratios
from labapp.accuracy.propagate import FieldReference, candidates, field_case_from_options
from labapp.accuracy.work_precision import measure
from labapp.common.speed import machine_speed
from optics.accuracy import Budget
from optics.plane import Plane
from optics.progress import Progress
from optics.threads import single_threaded

_PLANE = Plane((256, 256), (8e-6, 8e-6))
_DISTANCES = (0.01, 0.1)
_ALIKE = 1.3
"""Errors that differ by less are called equal: rounding in float32 is 2e-7 whoever does it."""


@single_threaded
def against_peers(folder: Path) -> list[Figure]:
    """Each library's every setting against our fastest that is at least as accurate, for both
    models and two distances."""
    budget, told, met = Budget(speed=machine_speed()), [], []
    for distance in _DISTANCES:
        for paraxial in (False, True):
            case = field_case_from_options(
                "smooth", _PLANE, _PLANE, distance, 550e-9, paraxial=paraxial
            )
            reference = FieldReference(case)
            ours = [one for one in candidates(case, reference, budget) if not one.calls]
            theirs = list(peer_candidates(case, reference.samples_of))
            rows = measure([*ours, *theirs], reference.exact_samples, Progress()).rows
            words, ahead = told_ratios(rows[: len(ours)], rows[len(ours) :], _ALIKE)
            model = "Fresnel" if paraxial else "scalar"
            told.append(f"{1e3 * distance:g} mm, {model}: {words}")
            met.append(ahead)
    known = [one for one in met if one is not None]
    return [
        Figure(
            "other libraries' time over ours for the same way through free space at equal error",
            "> 1 at every setting",
            " | ".join(told),
            all(known) if known else None,
        )
    ]


MEASUREMENTS = {"propagation-peers": against_peers}
