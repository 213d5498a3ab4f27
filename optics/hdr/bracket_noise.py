"""Estimate a sensor's gain and read noise from an exposure bracket itself.

Frames of one scene differ by their exposure times and by noise. The longer of two, scaled to the
shorter, takes the scene off, and what is left has the variance of both frames: photon transfer
(Janesick, Photon Transfer, SPIE Press 2007) without evenly lit frames. A pixel of s digital numbers
above darkness has the variance s / g + σ², with g electrons per digital number.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

from optics.validation import require_unmasked

Array = NDArray[np.float64]

# Pixels of a block: it tells its variance to 18 %, and one that moved is left out; chosen
_SIDE = 8
_BLOCKS = 20_000  # of a pair of frames: gains are right to some tenths of a percent; chosen
_OPEN = 0.9  # share of the range up to which pixels count, far enough from the clip level; chosen
_BINS = 20  # levels of light that the fit starts from; chosen
# Quantile of variances that is noise alone: a third of the blocks may hold what moved; chosen
_QUIET = 0.25
_FREEDOM = _SIDE**2 - 1  # degrees of freedom of a block's variance
_STRAY = 2.0  # deviations of a block's variance beyond which it doesn't count; chosen
_QUIET_VARIANCE = float(stats.chi2.ppf(_QUIET, _FREEDOM)) / _FREEDOM  # over the mean one
# Mean variance of the blocks that are kept, over that of all: the mean of a chi-squared
# distribution between two values has the one of two freedoms more
_ENDS = _FREEDOM * (1 + _STRAY * math.sqrt(2 / _FREEDOM) * np.array([-1, 1]))
_KEPT_MEAN = float(np.divide(*(np.diff(stats.chi2.cdf(_ENDS, _FREEDOM + k))[0] for k in (2, 0))))
_PASSES = 8  # of the fit; the last ones change the gain by less than 1e-3
# Blocks, their share, and deviations of the gain, at least; chosen
_FEWEST, _LEAST_SHARE, _SURE = 50, 0.3, 5.0
_ROUNDING = 1 / 12  # DN²: variance of rounding to whole numbers


@dataclass(frozen=True)
class BracketNoise:
    """Gain and read noise of a sensor, as frames of one scene show them.

    gain: electrons per digital number. read_noise: electrons, without that of rounding. Both with
    standard deviations. blocks: that told it. share: of all blocks that were looked at; of noise
    alone it is 0.95.
    """

    gain: float
    read_noise: float
    gain_deviation: float
    read_noise_deviation: float
    blocks: int
    share: float


@dataclass(frozen=True, eq=False)
class _Blocks:
    """Blocks of pairs of frames, less darkness, DN, (blocks, pixels)."""

    shorter: Array
    longer: Array

    def ratio(self, kept: NDArray[np.bool_] | None = None) -> float:
        """Return the light of the shorter frame over that of the longer one."""
        below = self.longer.sum(1)
        above = self.shorter.sum(1)
        if kept is not None and below[kept].sum() > 0:
            return float(above[kept].sum() / below[kept].sum())
        bright = below >= max(float(np.median(below)), 1e-9)
        return float(np.median(above[bright] / below[bright])) if bright.any() else math.nan


def estimate_bracket_noise(
    frames: Sequence[Any],
    darks: Sequence[Any],
    times: Sequence[float],
    full_scale: float,
    period: tuple[int, int] = (1, 1),
) -> BracketNoise:
    """Estimate a sensor's gain and read noise from frames of one scene.

    Parameters
    ----------
    frames : sequence of NDArray
        (rows, columns) digital numbers, proportional to light above their darkness.
    darks : sequence of NDArray or float
        Darkness of each frame, digital numbers.
    times : sequence of float
        Exposure times in seconds, which order the frames. Their ratios are measured.
    full_scale : float
        Digital number from which pixels are clipped.
    period : tuple of int, default (1, 1)
        (rows, columns) after which the sensor's colour filters repeat.

    Returns
    -------
    BracketNoise

    Raises
    ------
    ValueError
        If the frames don't tell: there is only one, they are dark or clipped, or more than noise
        differs between them.
    """
    require_unmasked(frames, darks)
    order = np.argsort(np.asarray(times, dtype=np.float64), kind="stable")
    pairs = []
    for both in itertools.pairwise(order):
        taken = [(frames[one], darks[one]) for one in both]
        found = _read_blocks(taken, full_scale, period)
        if len(found.longer) >= _FEWEST and found.ratio() > 0:
            pairs.append(found)
    if not pairs:
        raise ValueError("no two frames show the same light without clipping")
    return _fit(pairs)


def _read_blocks(frames: list[tuple[Any, Any]], full: float, period: tuple[int, int]) -> _Blocks:
    """Cut two frames into blocks, and keep those in which neither is near the clip level.

    frames: (numbers, darkness), the shorter one first.
    """
    down, along = period
    found: tuple[list[Array], list[Array]] = ([], [])
    for y, x in np.ndindex(period):
        is_open, light = np.array(True), []
        for frame, dark in frames:
            plane = frame[y::down, x::along]
            rows, columns = (n // _SIDE for n in plane.shape)
            every = max(1, math.ceil(rows * columns * down * along / _BLOCKS))
            numbers, level = _cut(plane, rows, columns, every), dark
            if np.ndim(dark):
                level = _cut(dark[y::down, x::along], rows, columns, every)
            light.append(numbers - level)
            is_open = is_open & np.all(numbers < level + _OPEN * (full - level), axis=1)
        for kept, one in zip(found, light, strict=True):
            kept.append(one[is_open])
    shorter, longer = (np.concatenate(one) for one in found)
    return _Blocks(shorter, longer)


def _cut(plane: NDArray[Any], rows: int, columns: int, every: int) -> Array:
    """Return one in `every` of a plane's blocks, evenly over it, (blocks, pixels)."""
    blocks = plane[: rows * _SIDE, : columns * _SIDE].reshape(rows, _SIDE, columns, _SIDE)
    row, column = (n.ravel()[::every] for n in np.mgrid[:rows, :columns])
    return blocks[row, :, column].reshape(len(row), -1).astype(np.float64)


def _fit(pairs: Sequence[_Blocks]) -> BracketNoise:
    """Fit gain and read noise to the variance that pairs of frames leave."""
    ratios = [one.ratio() for one in pairs]
    ends = np.cumsum([len(one.longer) for one in pairs])[:-1]
    law: Array | None = None
    for _ in range(_PASSES):
        light, floor, variance = _points(pairs, ratios)
        law = _start(light, floor, variance) if law is None else law
        expected = np.maximum(law[0] * light, 0) + law[1] * floor
        kept = _is_regular(pairs, ratios, law)
        # Least squares with weights, neither below 0.
        weight = 1 / np.maximum(expected[kept], 1e-12)
        design = np.stack([light[kept], floor[kept]], axis=1) * weight[:, None]
        law = optimize.nnls(design, variance[kept] * weight / _KEPT_MEAN)[0]
        ratios = [
            one.ratio(part) if part.sum() >= _FEWEST else ratio
            for one, part, ratio in zip(pairs, np.split(kept, ends), ratios, strict=True)
        ]
    assert law is not None
    if kept.sum() < _FEWEST or kept.mean() < _LEAST_SHARE:
        raise ValueError("more than noise differs between the frames")
    spread = np.sqrt(2 / _FREEDOM * np.diag(np.linalg.pinv(design.T @ design))).tolist()
    if not law[0] > _SURE * spread[0]:
        raise ValueError(
            "the frames don't tell photons' noise from the readout's: they are too small, or of "
            "too even a light"
        )
    gain = 1 / float(law[0])
    noise = math.sqrt(max(float(law[1]) - _ROUNDING, 0.0))
    # Where hardly any is seen, its square is uncertain, and not its own slope.
    uncertain = math.sqrt(noise**2 + spread[1]) - noise
    return BracketNoise(
        gain, gain * noise, gain**2 * spread[0], gain * uncertain, int(kept.sum()),
        float(kept.mean()),
    )  # fmt: skip


def _points(pairs: Sequence[_Blocks], ratios: Sequence[float]) -> tuple[Array, Array, Array]:
    """Return what multiplies 1 / g and σ² in each block, and the block's variance."""
    light, floor, variance = [], [], []
    for one, ratio in zip(pairs, ratios, strict=True):
        light.append(ratio * (1 + ratio) * one.longer.mean(1))
        floor.append(np.full(len(one.longer), 1 + ratio**2))
        variance.append(np.var(one.shorter - ratio * one.longer, axis=1, ddof=1))
    return np.concatenate(light), np.concatenate(floor), np.concatenate(variance)


def _start(light: Array, floor: Array, variance: Array) -> Array:
    """Return 1 / g and σ² by the quiet blocks at each level of light."""
    groups = np.array_split(np.argsort(light), _BINS)
    level = np.array([[light[one].mean(), floor[one].mean()] for one in groups])
    seen = np.array([np.quantile(variance[one], _QUIET) / _QUIET_VARIANCE for one in groups])
    weight = 1 / np.maximum(seen, 1e-12)
    law: Array = optimize.nnls(np.maximum(level, 0) * weight[:, None], seen * weight)[0]
    return law


def _is_regular(pairs: Sequence[_Blocks], ratios: Sequence[float], law: Array) -> NDArray[np.bool_]:
    """Return in which blocks nothing but noise differs, by the law of the noise."""
    found = []
    for one, ratio in zip(pairs, ratios, strict=True):
        light = ratio * (1 + ratio) * np.maximum(one.longer, 0)
        expected = np.maximum(law[0] * light + law[1] * (1 + ratio**2), 1e-12)
        left = one.shorter - ratio * one.longer
        left -= left.mean(1, keepdims=True)
        found.append((left**2 / expected).mean(1))
    shown = np.concatenate(found)
    noise = float(np.quantile(shown, _QUIET)) / _QUIET_VARIANCE
    return np.asarray(np.abs(shown - noise) <= _STRAY * math.sqrt(2 / _FREEDOM) * noise)
