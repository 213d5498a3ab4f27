"""Take exposure times from the files of a bracket, or compare told ones with these."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from labapp.common.errors import UserError
from optics.hdr import is_nominal, shutter_time

_DIFFERENT = 0.07
"""Logarithm by which a told time differs from the file's. Chosen: cameras round up to 6.7 %."""

_SAME = 1e-3
"""Relative difference up to which apertures, or ISO numbers, are one."""


def _facts(photograph: Any, name: str) -> float | None:
    """Return a number that a file tells of its exposure, or None."""
    value = getattr(getattr(photograph, "exposure", None), name, None)
    return float(value) if value is not None and 0 < value < math.inf else None


def choose_times(
    photographs: Sequence[Any], told: Sequence[float] | None, is_coded: bool
) -> tuple[list[float], list[str], list[str]]:
    """Return the exposure times, told or of the files, with notes and doubts in words."""
    if told is None:
        times, notes = times_of_files(photographs, is_coded)
        return times, notes, []
    return list(told), [], contradictions(photographs, told)


def times_of_files(photographs: Sequence[Any], is_coded: bool) -> tuple[list[float], list[str]]:
    """Return the exposure times that the files tell, and notes in words.

    The rounded numbers of cameras become the times that they stand for. Times of 8-bit pictures
    count apertures and ISO numbers, if these differ. Raises UserError if a file tells no time, and
    for other frames that differ in these.
    """
    told = [_facts(one, "exposure_time") for one in photographs]
    missing = [one.path for one, time in zip(photographs, told, strict=True) if time is None]
    if missing:
        raise UserError(
            f"--exposures is missing, and {missing[0]} doesn't tell its exposure time: give the "
            "time of each frame in seconds, in their order, as in --exposures 0.001,0.004 or "
            "1/250,1/60."
        )
    times = [time for time in told if time is not None]
    notes = ["exposure times are those that the files tell"]
    meant = [shutter_time(time) for time in times]
    if all(is_nominal(time) for time in times) and not np.allclose(times, meant, rtol=1e-3):
        notes[0] += ", by the steps that cameras' rounded numbers stand for, as 1/64 s for 1/60 s"
        times = meant
    factors = _light_factors(photographs)
    if factors is not None:
        if not is_coded:
            raise UserError(
                "the files tell different apertures or ISO numbers, and so different noise: merge "
                "frames that differ in their exposure times only, or give --exposures."
            )
        times = [time * factor for time, factor in zip(times, factors, strict=True)]
        notes.append(
            "the files tell different apertures or ISO numbers, which count as exposure: the "
            "aperture changes the depth of field, too, and ISO the noise"
        )
    return times, notes


def _light_factors(photographs: Sequence[Any]) -> list[float] | None:
    """Return the factors of the light by aperture and ISO; None if they don't differ."""
    found = np.ones(len(photographs))
    for name, power in (("f_number", -2), ("iso", 1)):
        values = [_facts(one, name) for one in photographs]
        known = [one for one in values if one is not None]
        if len(known) == len(values) and max(known) / min(known) > 1 + _SAME:
            found *= (np.array(known) / known[0]) ** power
    return None if (found == 1).all() else found.tolist()


def contradictions(photographs: Sequence[Any], times: Sequence[float]) -> list[str]:
    """Say in words which told times contradict those of the files."""
    own = [_facts(one, "exposure_time") for one in photographs]
    if any(one is None for one in own) or len(own) < 2:
        return []
    ratio = np.log(np.array(times) / np.array([one for one in own if one is not None]))
    factors = _light_factors(photographs)
    if factors is not None:
        ratio = ratio - np.log(factors)
    away = ratio - np.median(ratio)
    return [
        f"--exposures says {times[k]:.4g} s for {photographs[k].path.name}, which itself tells "
        f"{own[k]:.4g} s; by the others' ratio to theirs, {times[k] / math.exp(away[k]):.4g} s are "
        "expected. Leave --exposures out to take the files' times"
        for k in np.flatnonzero(np.abs(away) > _DIFFERENT).tolist()
    ]
