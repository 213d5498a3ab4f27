"""Compute mean and variance of a sensor's readout, for a known number of electrons in the well."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from optics.sensor.sensor import Sensor
from optics.sensor.stages import Stages

Numbers = NDArray[np.float64]

_MAX_DEVIATIONS = 8.5
"""Standard deviations of read noise that are summed; 1e-17 of the probability lies beyond."""


def readout_moments(electrons: Numbers, sensor: Sensor, stages: Stages) -> tuple[Numbers, Numbers]:
    """Compute mean and variance of a sensor pixel's readout through noise and ADC, exactly.

    The mean is in electrons, and the variance in electrons². electrons: in the well, with the
    pixel's offset; any shape. The readout is (number - black level) times the gain, clipped and
    rounded as `stages` says.
    """
    noise = sensor.read_noise if stages.read_noise else 0.0
    if stages.quantisation:
        scaled = electrons / sensor.gain + sensor.black_level
        mean, variance = _rounded_moments(scaled, noise / sensor.gain, sensor, stages.clipping)
        return (mean - sensor.black_level) * sensor.gain, variance * sensor.gain**2
    if stages.clipping:
        low = -sensor.black_level * sensor.gain
        return _clipped_moments(electrons, noise, low, low + sensor.top_number * sensor.gain)
    return electrons, np.full_like(electrons, noise**2)


def _clipped_moments(x: Numbers, noise: float, low: float, high: float) -> tuple[Numbers, Numbers]:
    """Compute mean and variance of the sensor's readout, clipped at both ends.

    Before clipping, the readout is a normal number with the mean x.
    """
    if not noise:
        return np.clip(x, low, high), np.zeros_like(x)
    a, b = (low - x) / noise, (high - x) / noise
    under, over = ndtr(a), ndtr(-b)
    inside = 1 - under - over
    density_a, density_b = _density(a), _density(b)
    shift = noise * (density_a - density_b + a * under + b * over)
    square = noise**2 * (inside + a * density_a - b * density_b + a**2 * under + b**2 * over)
    return x + shift, np.maximum(square - shift**2, 0.0)


def _density(z: Numbers) -> Numbers:
    return np.exp(-0.5 * np.minimum(z**2, 1400.0)) / math.sqrt(2 * math.pi)


def _rounded_moments(
    scaled: Numbers, noise: float, sensor: Sensor, clipping: bool
) -> tuple[Numbers, Numbers]:
    """Compute mean and variance of the sensor's readout, rounded by the ADC.

    Before rounding, the readout is a normal number with the mean `scaled`. Both moments are sums
    over the probabilities that the number reaches each whole step.
    """
    top = sensor.top_number
    if not noise:
        number = np.round(scaled)
        return np.clip(number, 0, top) if clipping else number, np.zeros_like(scaled)
    first = np.floor(scaled - _MAX_DEVIATIONS * noise - 0.5)
    base = np.clip(first, 0, top) if clipping else first
    mean, square = np.zeros_like(scaled), np.zeros_like(scaled)
    for step in range(1, math.ceil(2 * _MAX_DEVIATIONS * noise) + 3):
        number = first + step
        reached = ndtr((scaled - number + 0.5) / noise)
        if clipping:
            reached = np.where((number >= 1) & (number <= top), reached, 0.0)
        mean += reached
        square += (2 * (number - base) - 1) * reached
    return base + mean, np.maximum(square - mean**2, 0.0)
