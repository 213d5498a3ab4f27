"""Find frames of a bracket that were exchanged, by the brightness of whole frames.

The longer the exposure time, the brighter the frame, clipped or not. That tells even where no pixel
is measured well in two frames.
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_FALL = 0.05
"""Relative fall of the light from which on a frame is darker than one of a shorter exposure.
Chosen: lamps flicker, and things move."""

_LEAST_ROOM = 0.01
"""Part of the clip level by which a frame's mean is below it from which on it's darker than a
clipped one of a shorter exposure. Chosen."""

_SURE = 5.0
"""Standard deviations by which it's darker, at least."""


def find_disorder(light: Array, deviations: Array, times: Array) -> tuple[int, ...]:
    """Return frames whose light contradicts the order of a bracket's exposure times.

    Parameters
    ----------
    light : Array
        Mean light of each frame, clipped as it is, over the clip level.
    deviations : Array
        Its standard deviations.
    times : Array
        Exposure times.

    Returns
    -------
    tuple of int
        Indices: none if light rises with time; two if it does after these are exchanged, and after
        no others; else all that are darker than a frame of a shorter exposure, or that one.
    """
    falls = _falls(light, deviations, times)
    if not falls.any():
        return ()
    found = []
    for one, other in itertools.combinations(range(len(times)), 2):
        turned = np.arange(len(times))
        turned[[one, other]] = other, one
        if (
            times[one] != times[other]
            and not _falls(light[turned], deviations[turned], times).any()
        ):
            found.append((one, other))
    if len(found) == 1:
        return found[0]
    return tuple(np.flatnonzero(falls.any(axis=0) | falls.any(axis=1)).tolist())


def explain_disorder(frames: tuple[int, ...]) -> str:
    """Say in words which frames of an HDR bracket contradict the order of exposure times."""
    if len(frames) == 2:
        one, other = frames
        return (
            f"frames {one + 1} and {other + 1} look exchanged: each has the light of the other's "
            "exposure time. Exchange them"
        )
    listed = ", ".join(str(one + 1) for one in frames)
    return (
        f"frames {listed} don't get brighter with their exposure times: check their order, and "
        "the times"
    )


def _falls(light: Array, deviations: Array, times: Array) -> NDArray[np.bool_]:
    """Return which frames of a bracket, (shorter, longer), get darker with the exposure time."""
    noise = np.hypot(deviations[:, None], deviations)
    longer = times[:, None] < times
    # Of nearly clipped frames, what isn't clipped decides: the longer one must have less of it.
    left = 1 - light[:, None]
    allowed = np.minimum(_FALL * np.abs(light[:, None]), left + _LEAST_ROOM) + _SURE * noise
    return np.asarray(longer & (light < light[:, None] - allowed))
