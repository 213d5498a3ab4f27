"""Estimate how the rates of a scene's pixels are distributed, from one frame and its noise.

Noise makes the numbers of a frame vary more than the light does, above all in the dark. The
distribution of rates whose noisy numbers are the likeliest is found by expectation-maximisation
(Laird, JASA 73, 805, 1978, doi 10.1080/01621459.1978.10480103): no shape is assumed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from optics.camera import Sensor
from optics.hdr.exposure_snr import ExposureSNR

Array = NDArray[np.float64]

_PER_DECADE = 120
"""Rates for each factor of ten. Chosen: 2 % from one to the next."""

_BIN = 0.5
"""Width of the bins of numbers, in standard deviations of their noise. Chosen."""

_DARKEST = 0.3
"""Darkest rate that is told apart from none, in standard deviations of a frame's noise without
light. Chosen: below, ten thousand pixels tell hardly anything."""

_STEPS = 150
"""Steps of the iteration. Chosen: the quantile below which 1 % lies is then right to 4 %
where its pixels are twice their noise, and to 20 % where they are as large as it."""


@dataclass(frozen=True, eq=False)
class RateDistribution:
    """Distribution of the rates of a frame's pixels.

    rates: electrons per second, ascending; the first stands for all that the frame can't tell from
    darkness, the last for all that may be clipped. shares: of the pixels. time: of the frame.
    """

    rates: Array
    shares: Array
    time: float

    def quantile(self, share: float) -> float:
        """Return the rate below which a share of the pixels lies, electrons/s."""
        below = np.cumsum(self.shares)
        # Each rate stands for those half a step around it.
        middle = np.sqrt(self.rates[1:] * self.rates[:-1])
        return float(np.exp(np.interp(share, below[:-1], np.log(middle))))

    @property
    def is_clipped(self) -> bool:
        """Whether one pixel or more may be clipped in the frame."""
        return bool(self.shares[-1] > 0)


def rate_distribution(
    numbers: NDArray[np.generic], time: float, sensor: Sensor
) -> RateDistribution:
    """Estimate the distribution of rates from the numbers of a frame's pixels.

    numbers: digital numbers, of any shape.
    time: exposure time, seconds.
    """
    flat = np.asarray(numbers, dtype=np.float64).ravel()
    light = (flat - sensor.black_level) * sensor.gain - sensor.dark_current * time
    clipped = flat >= sensor.full_scale
    floor = ExposureSNR(sensor).floor(time)
    top = (sensor.full_scale - 0.5 - sensor.black_level) * sensor.gain
    top = max(top - sensor.dark_current * time, sensor.gain)
    edges = _bin_edges(sensor, floor, float(light.min()), top)
    counts = np.histogram(light[~clipped], edges)[0].astype(np.float64)
    darkest = min(_DARKEST * math.sqrt(floor), 0.1 * top)
    steps = math.ceil(math.log10(top / darkest) * _PER_DECADE)
    levels = np.geomspace(darkest, top, steps)
    chance = np.diff(ndtr((edges - levels[:, None]) / np.sqrt(levels + floor)[:, None]), axis=1)
    shares = np.zeros(steps)
    if counts.any():
        shares = _likeliest(chance[:, counts > 0], counts[counts > 0])
    # Clipped pixels stand one step above the brightest rate that isn't clipped.
    rates = np.append(levels, top * 10 ** (1 / _PER_DECADE)) / time
    share = float(clipped.mean())
    return RateDistribution(rates, np.append(shares * (1 - share), share), time)


def _bin_edges(sensor: Sensor, floor: float, darkest: float, top: float) -> Array:
    """Return edges of bins between digital numbers, in electrons of light.

    darkest, top: light in electrons that the bins span.
    """
    edges, gain = [darkest - sensor.gain / 2], sensor.gain
    while edges[-1] < top:
        noise = math.sqrt(max(edges[-1], 0.0) + floor)
        edges.append(edges[-1] + gain * max(1, int(_BIN * noise / gain)))
    return np.array(edges)


def _likeliest(chance: Array, counts: Array) -> Array:
    """Return the shares of rates that make a frame's numbers the likeliest.

    chance: of each bin, for each rate. counts: pixels in each bin.
    """
    seen = counts / counts.sum()
    shares = np.full(len(chance), 1 / len(chance))
    for _ in range(_STEPS):
        expected = np.maximum(shares @ chance, 1e-300)
        shares = shares * (chance @ (seen / expected))
        shares /= shares.sum()
    return shares
