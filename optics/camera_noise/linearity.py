"""Measure how far a camera's signal is from proportional to exposure time, and a lamp's drift."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from optics.camera_noise.group_statistics import GroupStatistics
from optics.camera_noise.measured import Array, Measured
from optics.camera_noise.saturation import is_open

_LOW, _HIGH = 0.05, 0.95
"""Shares of saturation between which linearity is judged (EMVA 1288, section 6.7)."""

_FEWEST = 4
"""Fewest exposure times from which linearity is told."""

_PASSES = 4
"""Passes in which a lamp's drift is found; a drift of a fifth is then right to 1e-4."""

_ALIKE = 0.9
"""Correlation of exposure time and clock from which drift can't be told from a bent line. Chosen:
exposures that only rise have .95 and more."""


@dataclass(frozen=True, eq=False)
class Linearity:
    """A camera's signal by exposure time, and how far it is from a line.

    error: mean absolute deviation, relative (EMVA's LE, as a share). drift: of the lamp from first
    to last exposure, relative; None where the order of exposures can't tell it. exposure, signal,
    deviation: seconds, DN and relative deviation of each point of the fit, drift taken off.
    rate: signal by time, DN/s.
    """

    error: Measured
    drift: Measured | None
    rate: float
    exposure: Array
    signal: Array
    deviation: Array


def measure_linearity(
    groups: Sequence[GroupStatistics], full: float | None, times: dict[float, float]
) -> Linearity | None:
    """Measure a camera's linearity error; None with fewer than four exposures in between.

    full: signal at which pixels clip, DN; the largest signal where none does. times: when each
    exposure was taken, seconds, by exposure time; empty if unknown. Light that drifts with time is
    fitted beside the line, if exposures weren't taken in the order of their length.
    """
    exposure, signal, sigma, colour = _points(groups, full)
    if len(set(exposure)) < _FEWEST:
        return None
    clock, span = _clock(exposure, times)
    drift, chance_of_drift = 0.0, 0.0
    # Signals that drift is taken off from follow the line better, and tell what is left of it.
    for _ in range(_PASSES if span else 1):
        steady = signal / (1 + drift * clock)
        matrix = _design(exposure, steady, colour, clock if span else None)
        inverse = np.linalg.pinv(matrix.T @ matrix)
        found = inverse @ matrix.T @ np.ones(len(steady))
        drift += float(found[-1]) if span else 0.0
    deviation = 1 - matrix @ found
    freedom = max(len(signal) - matrix.shape[1], 1)
    if span:
        chance_of_drift = math.sqrt(float((deviation**2).sum()) / freedom * inverse[-1, -1])
    size = np.abs(deviation)
    # Chance alone makes a mean deviation, too.
    chance = float((sigma / signal).mean())
    slopes = found[1 : 2 * len(set(colour)) : 2]
    return Linearity(
        Measured(float(size.mean()), math.hypot(float(size.std()) / math.sqrt(len(size)), chance)),
        Measured(drift, chance_of_drift) if span else None,
        float(np.mean(slopes)), exposure, steady, deviation,
    )  # fmt: skip


def _clock(exposure: Array, times: dict[float, float]) -> tuple[Array, float]:
    """Return when each of a camera's points was taken, from -.5 to .5, and the whole time in s.

    The time is 0 where it is unknown, or where exposures were taken in the order of their length.
    """
    span = float(np.ptp(list(times.values()))) if times else 0.0
    if not span:
        return np.zeros_like(exposure), 0.0
    clock = np.array([times[one] for one in exposure])
    if abs(float(np.corrcoef(exposure, clock)[0, 1])) > _ALIKE:
        return np.zeros_like(exposure), 0.0
    return (clock - (max(times.values()) + min(times.values())) / 2) / span, span


def _design(
    exposure: Array, signal: Array, colour: Sequence[tuple[int, int]], clock: Array | None
) -> Array:
    """Return the matrix of a camera's lines, one for each colour, and of drift, over the signals.

    Relative deviations are made the smallest (EMVA 1288, section 6.7).
    """
    columns = []
    for name in sorted(set(colour)):
        own = np.array([float(one == name) for one in colour])
        columns += [own, own * exposure]
    if clock is not None:
        columns.append(signal * clock)
    return np.asarray(np.stack(columns, axis=1) / signal[:, None])


def _points(
    groups: Sequence[GroupStatistics], full: float | None
) -> tuple[Array, Array, Array, list[tuple[int, int]]]:
    """Return exposure, signal, its noise and the filter's colour of a camera's mean signals."""
    rows: list[tuple[float, float, float]] = []
    colours = []
    for colour in sorted({group.filter for group in groups}):
        same = [group for group in groups if group.filter == colour]
        for light in zip(*(group.light for group in same), strict=True):
            weights = np.array([one.count for one in light], dtype=np.float64)
            signal = float(np.average([one.signal for one in light], weights=weights))
            top = full or max(one.signal for group in same for one in group.light)
            if all(is_open(one, top, _HIGH) for one in light) and signal > _LOW * top:
                variance = float(np.average([one.variance for one in light], weights=weights))
                noise = math.sqrt(variance / (2 * weights.sum()))
                rows.append((light[0].exposure, signal, noise))
                colours.append(colour)
    columns = np.array(rows).reshape(-1, 3).T
    return columns[0], columns[1], columns[2], colours
