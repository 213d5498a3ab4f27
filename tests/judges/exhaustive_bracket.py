"""The quickest exposure bracket by exhaustive search, with the noise of EMVA 1288 written anew."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp

from optics.camera import Sensor
from optics.hdr import ExposureLimits, WantedSNR


@dataclass(frozen=True)
class Judged:
    """The quickest bracket on a grid of exposure times: seconds and frames."""

    duration: float
    frames: int


def exhaustive(
    sensor: Sensor,
    wanted: WantedSNR,
    limits: ExposureLimits,
    step: float = 1.1,
    most: int = 5,
    seconds: float = 30.0,
) -> Judged:
    """Search all numbers of frames at each of many exposure times, by mixed integer programming.

    An exposure counts below three standard deviations from its clip level. Frames of one time share
    the noise of their darks, so that each number of them is a choice of its own.
    """
    top = (sensor.full_scale - 0.5 - sensor.black_level) * sensor.gain
    first = max(limits.shortest, 0.02 * top / wanted.high)
    last = min(limits.longest, top / wanted.low)
    times = np.geomspace(first, last, 2 + int(math.log(last / first) / math.log(step)))
    times = np.unique(np.round(np.append(times, 0.95 * top / wanted.high), 6))
    times = times[times >= limits.shortest]
    floor = sensor.read_noise**2 + sensor.gain**2 / 12 + sensor.dark_current * times
    level = top - sensor.dark_current * times
    root = (np.sqrt(9 + 4 * (level + floor)) - 3) / 2
    brightest = (root**2 - floor) / times
    inside = brightest[(brightest > wanted.low) & (brightest < wanted.high)]
    even = np.geomspace(wanted.low, wanted.high, 60)
    rates = np.append(even, inside * (1 + 1e-9))[:, None]
    numbers = range(1, most + 1) if math.isfinite(wanted.darks) else [1]
    light = rates * times
    told = np.hstack(
        [
            np.where(rates <= brightest, n * light**2 / (light + floor * (1 + n / wanted.darks)), 0)
            for n in numbers
        ]
    )
    cost = np.concatenate([(n + wanted.counted_darks) * (times + limits.readout) for n in numbers])
    frames = np.repeat(list(numbers), len(times))
    enough = LinearConstraint(told / 10 ** (wanted.snr_db / 10), 1, np.inf)
    once = LinearConstraint(np.hstack([np.eye(len(times))] * len(numbers)), 0, 1)
    shared = len(numbers) > 1
    options = {"mip_rel_gap": 2e-3, "time_limit": seconds}
    found = milp(
        cost / cost.max(), integrality=np.ones(len(cost)), options=options,
        constraints=[enough, once] if shared else [enough],
        bounds=Bounds(0, 1 if shared else np.inf),
    )  # fmt: skip
    assert found.x is not None, found.message
    return Judged(float(cost @ found.x), round(float(frames @ found.x)))
