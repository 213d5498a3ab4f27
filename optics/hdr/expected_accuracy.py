"""Tell how accurate a merge is: against the least variance that any unbiased merge can have."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from optics.hdr.bracket import Bracket
from optics.hdr.clip_levels import least_variance
from optics.hdr.merging import merge
from optics.hdr.weighted_mean import Method

Array = NDArray[np.float64]

_SURELY = 8.0  # deviations from the clip level from which an exposure surely clips, or doesn't


@dataclass(frozen=True, eq=False)
class ExpectedAccuracy:
    """Accuracy of merged pixels at several rates, from simulated frames of even light.

    rates: electrons per second. errors: root mean square, relative. biases: relative. efficiencies:
    least variance over mean squared error. bias_noise: standard deviation of each bias by chance.
    """

    rates: Array
    errors: Array
    biases: Array
    efficiencies: Array
    bias_noise: Array


def cramer_rao_variance(bracket: Bracket, rate: float) -> float:
    """Return the least variance that an unbiased estimate of a rate can have.

    A clipped exposure counts as one of which only is known that it is above its clip level.
    Infinite where all exposures are clipped.
    """
    information = 0.0
    for exposure in bracket.exposures:
        each = rate * exposure.time + exposure.floor
        deviation = np.sqrt(each + exposure.floor / exposure.darks)
        above = (rate * exposure.time - exposure.clip_level) / deviation
        if above < -_SURELY:
            count = len(exposure.frames)
            information += exposure.time**2 / (each / count + exposure.floor / exposure.darks)
        elif above < _SURELY and information:
            shorter = exposure.time / deviation / np.sqrt(information)
            least = float(least_variance(np.array([above]), shorter)[0])
            information = exposure.time**2 / (deviation**2 * least)
    return 1 / information if information else np.inf


def expected_accuracy(
    bracket: Bracket,
    rates: Array,
    method: Method = "full",
    pixels: int = 4000,
    seed: int = 0,
) -> ExpectedAccuracy:
    """Merge simulated frames of even light, with a bracket's exposures, darks and sensor.

    Parameters
    ----------
    bracket : Bracket
        Its frames aren't used.
    rates : NDArray
        Electrons per second.
    method : str
        How frames are merged.
    pixels : int, default 4000
        For each rate.
    seed : int, default 0
        Of the simulated noise.

    Returns
    -------
    ExpectedAccuracy
    """
    rng, sensor = np.random.default_rng(seed), bracket.sensor
    levels = {exposure.time: exposure.dark_level for exposure in bracket.exposures}
    shape = (len(rates), pixels)

    def numbers(light: Array | float, level: float, averaged: float = 1.0) -> Array:
        noise = rng.normal(0, sensor.read_noise / np.sqrt(averaged), shape)
        return np.asarray((rng.poisson(light, shape) + noise) / sensor.gain + level)

    frames, darks, shared = [], [], {}
    for time, count in zip(bracket.times, bracket.dark_counts, strict=True):
        level, current = levels[time], sensor.dark_current * time
        light = np.minimum(rates[:, None] * time + current, 10 * sensor.full_well)
        taken = numbers(light, level - current / sensor.gain)
        frames.append(np.clip(np.round(taken), 0, sensor.top_number))
        if time not in shared:
            noise = np.sqrt((sensor.read_noise**2 + sensor.gain**2 / 12 + current) / count)
            shared[time] = level + rng.normal(0, noise / sensor.gain, shape)
        darks.append(shared[time])
    made = Bracket(frames, bracket.times, darks, bracket.dark_counts, sensor)
    error = merge(made, method).rate.numpy().astype(np.float64) / rates[:, None] - 1
    least = np.array([cramer_rao_variance(bracket, rate) for rate in rates]) / rates**2
    squares = (error**2).mean(axis=1)
    return ExpectedAccuracy(
        rates, np.sqrt(squares), error.mean(axis=1), least / squares,
        error.std(axis=1) / np.sqrt(pixels),
    )  # fmt: skip
