"""Uses methods once, on a similar case, before their first answers are timed."""

from __future__ import annotations

from collections.abc import Iterable

from labapp.accuracy.work_precision import Candidate

_LOOSE = 5e-3
"""Tolerances above it are used to warm up; chosen, because strict ones may take long."""


def similar_wavelength(wavelength: float) -> float:
    """Return a nearby wavelength, for which nothing is cached yet.

    The methods do the same for both, but nothing that is kept for the one serves the other.
    """
    return wavelength * (1 + 1e-4)


def first_uses(candidates: Iterable[Candidate]) -> list[Candidate]:
    """Return the candidates with which methods are used for the first time.

    Libraries that are loaded and memory that is allocated then are in no row's time.
    """
    return [one for one in candidates if one.row.tol is not None and one.row.tol > _LOOSE]
