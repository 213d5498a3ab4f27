"""Merging of exposure brackets against the Cramér-Rao bound, far from clip levels and near them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from figures import Figure
from optics.camera import Sensor
from optics.hdr import MOVED, Bracket, cramer_rao_variance, measure_exposure_factors, merge
from optics.threads import single_threaded

_SENSOR = Sensor(
    bits=12, full_well=1e6, gain=2.6, read_noise=2.4, dark_current=1.0, black_level=64.0
)
_PIXELS = 100_000
_EFFICIENCY_GOAL, _NEAR_GOAL, _BIAS_GOAL = 0.98, 0.9, 1e-3
_RANGE = 1e6
_FACTOR_GOAL = 1e-3


@dataclass(frozen=True)
class Seen:
    """A merged rate against the truth. efficiency: least variance over mean squared error. bias:
    relative. chance: standard deviation of the bias, relative. stated: mean squared error over the
    mean stated variance. moved: share of pixels that are said to contradict themselves."""

    efficiency: float
    bias: float
    chance: float
    stated: float
    moved: float


def _bracket(rate: float, times: list[float], darks: int, rng: np.random.Generator) -> Bracket:
    """Even light by the definitions of EMVA 1288; frames of one time share their dark frames."""

    def numbers(light: float, averaged: int = 1) -> np.ndarray:
        taken = [
            np.round((rng.poisson(light, (1, _PIXELS)) + rng.normal(0, 2.4, (1, _PIXELS))) / 2.6)
            for _ in range(averaged)
        ]
        return np.clip(np.mean(taken, axis=0) + 64, 0, 4095).astype(np.float32)

    dark = {t: numbers(_SENSOR.dark_current * t, darks) for t in times}
    frames = [numbers((rate + _SENSOR.dark_current) * t) for t in times]
    return Bracket(frames, times, [dark[t] for t in times], [darks] * len(times), _SENSOR)


def _judge(rate: float, times: list[float], darks: int, rng: np.random.Generator) -> Seen:
    bracket = _bracket(rate, times, darks, rng)
    found = merge(bracket)
    error = found.rate.numpy().astype(np.float64) - rate
    squares = float((error**2).mean())
    variance = found.variance.numpy().astype(np.float64)
    return Seen(
        cramer_rao_variance(bracket, rate) / squares,
        float(error.mean()) / rate,
        float(error.std()) / rate / math.sqrt(_PIXELS),
        squares / float(variance.mean()),
        float((found.state == MOVED).double().mean()),
    )


def _ladders() -> Iterator[tuple[list[float], int]]:
    """Brackets of two to eight exposures with factors from 2 to 16, and darks from 1 to 16."""
    for (count, ratio), darks in itertools.product(
        ((2, 4), (3, 16), (4, 8), (6, 4), (8, 2)), (1, 4, 16)
    ):
        yield [1e-3 * ratio**k for k in range(count)], darks


@single_threaded
def bracket_figures(folder: Path) -> list[Figure]:
    """Even light of half a decade each, and of half a percent each near clip levels."""
    rng = np.random.default_rng(20261127)
    top = (_SENSOR.full_scale - 0.5 - 64) * _SENSOR.gain
    far, near = [], {2: [], 4: [], 16: []}
    for times, darks in _ladders():
        brightest = 0.5 * top / times[0]
        for rate in brightest / 10 ** np.arange(0, math.log10(_RANGE) + 0.1, 0.5):
            if all(abs(math.log(rate * t / top)) > 0.3 for t in times):
                far.append(_judge(float(rate), times, darks, rng))
    for ratio, seen in near.items():
        times = [1e-3 * ratio**k for k in range(3)]
        for share in np.arange(0.95, 1.0501, 0.005):
            seen.append(_judge(share * top / times[-1], times, 4, rng))
    every = [one for seen in near.values() for one in seen]
    # The mean of so many squares is itself known to some parts in a thousand only.
    sure = 3 * math.sqrt(2 / _PIXELS)
    least = min(one.efficiency for one in far)
    bias = max(abs(one.bias) - 3 * one.chance for one in every)
    stated = [one.stated for one in far]
    close = [one.stated for one in every]
    return [
        Figure(
            "merged brackets against the Cramér-Rao bound, every half decade of six",
            f"efficiency ≥ {_EFFICIENCY_GOAL:g}",
            f"least {least:.3f} of {len(far)}",
            least >= _EFFICIENCY_GOAL - sure,
        ),
        Figure(
            "bias every half decade",
            "≤ 3 standard errors",
            f"largest {max(abs(one.bias) / one.chance for one in far):.1f}, of 1e5 pixels; "
            f"{sum(abs(one.bias) > 3 * one.chance for one in far)} of {len(far)} beyond",
            sum(abs(one.bias) > 3 * one.chance for one in far) <= 0.01 * len(far),
        ),
        Figure(
            "mean squared error over mean stated variance, one to sixteen darks",
            ".95 to 1.05",
            f"{min(stated):.3f} to {max(stated):.3f}",
            0.95 - sure <= min(stated) and max(stated) <= 1.05 + sure,
        ),
        Figure(
            "efficiency within 5 % of a clip level, bins of .5 %, factors of 2, 4, 16",
            f"≥ {_NEAR_GOAL:g}",
            "least "
            + ", ".join(f"{min(one.efficiency for one in seen):.2f}" for seen in near.values()),
            min(one.efficiency for one in every) >= _NEAR_GOAL,
        ),
        Figure(
            "bias there, beyond three standard errors",
            f"≤ {_BIAS_GOAL:.1%}",
            f"largest {max(bias, 0.0):.3%}",
            bias <= _BIAS_GOAL,
        ),
        Figure(
            "mean squared error over mean stated variance there",
            ".9 to 1.1",
            f"{min(close):.3f} to {max(close):.3f}",
            min(close) >= 0.9 and max(close) <= 1.1,
        ),
        Figure(
            "still pixels that are said to contradict themselves",
            "≤ .1 %",
            f"at most {max(one.moved for one in (*far, *every)):.3%}",
            max(one.moved for one in (*far, *every)) <= 1e-3,
        ),
        _factor_figure(rng),
    ]


def _factor_figure(rng: np.random.Generator) -> Figure:
    """Exposures that are 3 % off, and a scene of five decades on 1e5 pixels."""
    worst = 0.0
    for count, ratio in ((2, 8), (3, 16), (4, 4), (8, 2)):
        times = 1e-3 * float(ratio) ** np.arange(count)
        factors = np.exp(rng.normal(0, 0.03, count))
        factors /= np.exp(np.median(np.log(factors)))
        rate = 4031 * 2.6 / times[0] * 10 ** rng.uniform(-5, 0.2, (250, 400))
        frames = [
            np.clip(np.round((rng.poisson(rate * t) + rng.normal(0, 2.4, rate.shape)) / 2.6) + 64,
                    0, 4095)
            for t in times * factors
        ]  # fmt: skip
        bracket = Bracket(frames, times, [64.0] * count, [math.inf] * count, _SENSOR)
        found = measure_exposure_factors(bracket)
        worst = max(worst, float(np.abs(found.factors / factors - 1).max()))
    return Figure(
        "exposures 3 % off, measured on 1e5 pixels", f"≤ {_FACTOR_GOAL:.1%} each",
        f"largest error {worst:.3%}", worst <= _FACTOR_GOAL,
    )  # fmt: skip


MEASUREMENTS = {"brackets": bracket_figures}
