"""Measure how far frames differ from their stated exposure times, or if some were exchanged."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from optics.hdr.bracket import Bracket

Array = NDArray[np.float64]

# Of the light against a shorter exposure, relative: lamps flicker, and things move; chosen
_FALL = 0.05
_LEAST_ROOM = 0.01  # of the clip level: below a clipped one of a shorter exposure; chosen
_SURE = 5.0  # standard deviations by which it's darker, at least


def find_disorder(light: Array, deviations: Array, times: Array) -> tuple[int, ...]:
    """Return frames whose light contradicts the order of their times.

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
    """Say in words which frames contradict the order of their times."""
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
    """Return which pairs of frames, (shorter, longer), get darker with time."""
    noise = np.hypot(deviations[:, None], deviations)
    longer = times[:, None] < times
    # Of nearly clipped frames, what isn't clipped decides: the longer one must have less of it.
    left = 1 - light[:, None]
    allowed = np.minimum(_FALL * np.abs(light[:, None]), left + _LEAST_ROOM) + _SURE * noise
    return np.asarray(longer & (light < light[:, None] - allowed))


_PIXELS = 100_000  # looked at, evenly over the frames: ratios are right to 0.1 %; chosen
_ROUNDS = 12  # Newton steps at most: factors of 1.03 take four, two exchanged frames nine
_SAFE = 8.0  # deviations from the clip level within which an exposure of a pixel isn't used
_LEAST_SIGNAL = 5.0  # signal over noise of a pixel from which on it is used
_STRAY = 5.0  # robust deviations of a residual beyond which something moved in a pixel
_LEAST_PIXELS = 30  # common to two frames, from which on their ratio counts; chosen
# Flicker of a frame over what it could be: those of the scale may, too; chosen
_FLICKER_MARGIN = 1.5
_DRIFT = 0.1  # of a frame's level over a pixel's noise: some tenths of an electron; chosen
_EXCHANGED = 0.1  # part of a factor's logarithm that exchanged frames miss each other's by; chosen
_PERMUTED = 0.1  # relative difference of exposures from each other's times in a wrong order; chosen
# Relative, and deviations, by which a named frame differs; chosen
_NOTABLE, _EXPOSURE_FACTORS_SURE = 0.025, 5.0


@dataclass(frozen=True, eq=False)
class ExposureFactors:
    """Light of frames over that of their stated times.

    factors: one for each frame, with the middle one 1. deviations: their standard deviations;
    infinite, with a factor of 1, for frames that share too few pixels with the others.
    scatter: root mean square of what they leave, over the noise: 1 if the noise is known.
    pixels: that told. disordered: indices of frames whose brightness contradicts the order of
    exposure times; two, if these are exchanged, and then their factors are those of each other's
    time.
    """

    times: Array
    factors: Array
    deviations: Array
    scatter: float
    pixels: int
    disordered: tuple[int, ...] = ()

    @property
    def corrections(self) -> Array:
        """Return the frames' factors that surely aren't 1, and 1 for all others."""
        sure = np.abs(np.log(self.factors)) > _EXPOSURE_FACTORS_SURE * self.deviations
        if len(self.disordered) == 2:
            sure[list(self.disordered)] = True
        return np.where(sure, self.factors, 1.0)

    @property
    def suspects(self) -> list[int]:
        """Return the indices of frames whose time is surely another."""
        away = np.abs(np.log(self.factors))
        notable = (away > _NOTABLE) & (away > _EXPOSURE_FACTORS_SURE * self.deviations)
        return np.flatnonzero(notable).tolist()

    def explain(self, flicker_period: float = 0.01) -> list[str]:
        """Say in words what is wrong with the times; nothing if all are right.

        flicker_period: seconds in which lamps may flicker.
        """
        if self.disordered:
            # Their dark frames are those of other times, too, so that others may look wrong.
            return [explain_disorder(self.disordered)]
        found, rest = [], self.suspects
        for one, other in itertools.combinations(self.suspects, 2):
            # Exchanged frames have each other's times.
            logs, wanted = np.log(self.factors[[one, other]]), self.times[other] / self.times[one]
            expected = math.log(wanted) * np.array([1, -1])
            if wanted != 1 and (np.abs(logs - expected) < _EXCHANGED * np.abs(expected)).all():
                rest = [k for k in rest if k not in (one, other)]
                found.append(explain_disorder((one, other)))
        for one in rest:
            time, factor = self.times[one], self.factors[one]
            cause = "it was exposed otherwise, or something changed in all of the picture"
            # The most by which a part of a period changes the light, if that goes down to 0.
            if abs(factor - 1) <= _FLICKER_MARGIN * flicker_period / (math.pi * time):
                cause += (
                    f"; or the light flickers, with a period near {flicker_period * 1e3:.3g} ms: "
                    "expose for whole periods"
                )
            found.append(
                f"frame {one + 1} has {factor:.3g} times the light of {time:.3g} s, as of "
                f"{factor * time:.3g} s: {cause}"
            )
        return found


def measure_exposure_factors(bracket: Bracket, pixels: int = _PIXELS) -> ExposureFactors:
    """Measure the light of frames over that of their stated times.

    Parameters
    ----------
    bracket : Bracket
        Two frames at least.
    pixels : int, default 100000
        Pixels to look at, at most, evenly over the frames.

    Returns
    -------
    ExposureFactors

    Raises
    ------
    ValueError
        For a single frame, and if too few pixels are bright without being clipped in two frames.
    """
    times = bracket.times
    if len(times) < 2:
        raise ValueError("one frame has no ratio of exposures; give two at least")
    light, clipped = _sample(bracket, pixels)
    # The variance without light, electrons², and the clip level, electrons.
    floors, levels = np.zeros((2, len(times), 1))
    for exposure in bracket.exposures:
        floors[list(exposure.frames)] = exposure.floor * (1 + 1 / exposure.darks)
        levels[list(exposure.frames)] = exposure.clip_level
    shown = np.where(clipped, levels, light)
    variance = (np.maximum(shown, 0) + floors).mean(axis=1) / shown.shape[1]
    variance += _DRIFT**2 * floors[:, 0]
    level = levels[:, 0]
    disordered = find_disorder(shown.mean(axis=1) / level, np.sqrt(variance) / level, times)
    expected = np.zeros(len(times))
    if len(disordered) == 2:
        one, other = disordered
        expected[one] = math.log(times[other] / times[one])
        expected[other] = -expected[one]
    logs = expected.copy()
    for _ in range(_ROUNDS):
        step = _Step(light, clipped, times * np.exp(logs), floors, levels)
        linked = step.linked_frames()
        change, covariance = step.solve(linked)
        logs += change
        if np.abs(change).max() < 1e-5:
            break
    logs[linked] -= np.median((logs - expected)[linked])
    if (linked & (np.abs(logs - expected) > _EXCHANGED * np.abs(expected)) & (expected != 0)).any():
        # Another exposure time than that of the other frame made it dark, or bright.
        disordered, logs = (), np.where(linked, logs - np.median(logs[linked]), 0.0)
    scatter, factors = step.scatter, np.exp(logs)
    deviations = np.where(linked, np.sqrt(np.diag(covariance)) * max(1.0, scatter), math.inf)
    if len(disordered) > 2 and linked[list(disordered)].all():
        ratios = np.sort(times * factors) / np.sort(times)
        if np.ptp(np.log(ratios)) >= _PERMUTED:
            # The frames don't have each other's times: some exposures are wrong, or light flickers.
            disordered = ()
    return ExposureFactors(times, factors, deviations, scatter, step.count, disordered)


def _sample(bracket: Bracket, pixels: int) -> tuple[Array, NDArray[np.bool_]]:
    """Return electrons in some of the pixels, (frames, pixels), and which clip."""
    rows, columns = bracket.shape
    count = max(1, min(rows, pixels // columns))
    chosen = np.unique(np.linspace(0, rows - 1, count).round().astype(int))
    parts = [
        [bracket.electrons(index, slice(row, row + 1)) for row in chosen]
        for index in range(len(bracket.times))
    ]
    light, clipped = (
        np.array([np.concatenate([one[k] for one in frame]) for frame in parts]) for k in (0, 1)
    )
    every = max(1, light.shape[1] // pixels)
    return light[:, ::every].astype(np.float64), clipped[:, ::every]


class _Step:
    """A Newton step of the factors' logarithms, with the radiance of all pixels eliminated."""

    def __init__(
        self, light: Array, clipped: NDArray[np.bool_], times: Array, floors: Array, levels: Array
    ) -> None:
        self._light, self._times, self._floors = light, times[:, None], floors
        rate = np.zeros(light.shape[1])
        for _ in range(3):
            rate = self._rate(rate, ~clipped)
        shown = self._times * np.maximum(rate, 0)
        # Whether an exposure clips is told by the others too: its own value depends on chance.
        used = (levels - shown > _SAFE * np.sqrt(shown + floors)) & ~clipped
        for _ in range(2):
            rate = self._rate(rate, used)
        shown = self._times * np.maximum(rate, 0)
        variance = shown + floors
        used &= (shown**2 / variance).max(axis=0) > _LEAST_SIGNAL**2
        residual = (light - shown) / np.sqrt(variance)
        regular = np.ones_like(used)
        for one, mask, row in zip(residual, used, regular, strict=True):
            if mask.any():
                middle = np.median(one[mask])
                spread = max(1.0, 1.4826 * float(np.median(np.abs(one[mask] - middle))))
                row[:] = np.abs(one - middle) < _STRAY * spread
        # Where one exposure strays, the others are compared with a wrong radiance.
        used &= (regular | ~used).all(axis=0) & (used.sum(0) > 1)
        self._shown, self._variance, self._used = shown, variance, used
        self.count = int((used.sum(0) > 1).sum())
        freedom = used.sum() - self.count - (len(times) - 1)
        pairs = zip(residual, used, strict=True)
        middles = np.array([np.median(one[mask]) if mask.any() else 0.0 for one, mask in pairs])
        squares = ((residual - middles[:, None]) ** 2 * used).sum()
        self.scatter = math.sqrt(squares / freedom) if freedom > 0 else 1.0

    def _rate(self, rate: Array, used: NDArray[np.bool_]) -> Array:
        """Return the pixels' rates by weights that a rate predicts."""
        weight = used * self._times / (self._times * np.maximum(rate, 0) + self._floors)
        below = (weight * self._times).sum(0)
        return np.asarray((weight * self._light).sum(0) / np.where(below > 0, below, 1))

    def linked_frames(self) -> NDArray[np.bool_]:
        """Return the largest group of frames that common pixels link together.

        Raises ValueError if no two are.
        """
        used = self._used.astype(np.float32)
        _, group = connected_components(used @ used.T >= _LEAST_PIXELS, directed=False)
        largest = np.argmax(np.bincount(group))
        if (group == largest).sum() < 2:
            raise ValueError(
                "no pixels are bright, and not clipped, in two frames: nothing tells their ratios. "
                "Add exposures between them"
            )
        return np.asarray(group == largest)

    def solve(self, linked: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Return the change of the factors' logarithms, and their covariance.

        linked: frames that have a factor; that of others doesn't change.
        """
        information = self._shown**2 / self._variance * self._used
        slope = self._shown * (self._light - self._shown) / self._variance * self._used
        whole = np.maximum(information.sum(0), 1e-30)
        matrix = np.diag(information.sum(1)) - (information / whole) @ information.T
        covariance = np.zeros_like(matrix)
        few = np.ix_(linked, linked)
        covariance[few] = np.linalg.pinv(matrix[few], rcond=1e-10, hermitian=True)
        return np.clip(covariance @ slope.sum(1), -0.7, 0.7), covariance
