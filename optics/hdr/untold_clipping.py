"""Find where pixels clip from metering frames of several exposures, where nobody has told it."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from optics.camera import Sensor
from optics.sensor.pile import top_pile

Array = NDArray[np.float64]

_BRIGHTEST = 0.01
"""Share of the range below the largest number in which pixels count as the brightest. Chosen."""

_MISSED = 1.02
"""Light by the shorter exposure over that of the longer one, of the brightest pixels, from which on
these are clipped. Chosen: lamps vary by less from frame to frame."""

_SIGMAS = 3.0
"""Deviations by which light must be missed to be missed. Chosen."""

_PRECISE = 0.03
"""Three deviations of that ratio up to which it proves that pixels aren't clipped. Chosen."""

_APART = 1.25
"""Ratio of two exposures from which on they are compared. Chosen."""

_HIGHER = 1.1
"""Range of numbers of any frame over that of another one from which on the camera goes on above the
other's, so that this isn't clipped. Chosen."""

_LEAST_ROOM = 8.0
"""Numbers above the black level that a clip level must lie, at least. Chosen."""


def untold_clip_level(frames: Mapping[float, Array], sensor: Sensor) -> int | None:
    """Return the number at which pixels clip below the sensor's full scale; None if none is seen.

    frames: numbers by exposure in seconds, of one HDR scene. Pixels clip where a shorter exposure
    says that they have more light, or where many share the largest number of all frames. If these
    happen to have the same light, a shorter exposure is taken in vain.
    """
    found = []
    highest = max(float(frame.max()) for frame in frames.values())
    for time, frame in frames.items():
        top = float(frame.max())
        if not sensor.black_level + _LEAST_ROOM <= top < sensor.full_scale:
            continue
        shorter = [one for one in frames if one * _APART <= time]
        told = [_missed_light(frames, one, time, sensor) for one in shorter]
        piled = top == highest and top_pile(frame) is not None
        if piled or any(missed > _MISSED + _SIGMAS * sigma for missed, sigma in told):
            found.append(int(top))
    return min(found, default=None)


def is_surely_open(frames: Mapping[float, Array], time: float, sensor: Sensor) -> bool:
    """Return whether metering frames of an HDR scene prove that one of them isn't clipped.

    They do if another one has larger numbers, or if a shorter exposure says the same light.
    """
    room = float(frames[time].max()) - sensor.black_level
    highest = max(float(frame.max()) for frame in frames.values()) - sensor.black_level
    if highest > _HIGHER * max(room, 0.0):
        return True
    shorter = [one for one in frames if one * _APART <= time]
    told = (_missed_light(frames, one, time, sensor) for one in shorter)
    return any(missed <= _MISSED and _SIGMAS * sigma < _PRECISE for missed, sigma in told)


def _missed_light(
    frames: Mapping[float, Array], short: float, long: float, sensor: Sensor
) -> tuple[float, float]:
    """Return the light of an HDR frame's brightest pixels by a shorter one, over its own.

    And the deviation of this ratio. The pixels are chosen by the longer exposure, so that chance
    makes the ratio too small, if anything: where pixels clip, there is no chance in it.
    """
    frame, black = frames[long], sensor.black_level
    room = float(frame.max()) - black
    brightest = frame >= frame.max() - _BRIGHTEST * room
    own = float(frame[brightest].mean()) - black
    before = float(frames[short][brightest].mean()) - black
    electrons = max(before, 0.0) * sensor.gain
    variance = (electrons + sensor.read_noise**2) / sensor.gain**2 + 1 / 12
    deviation = math.sqrt(variance / np.count_nonzero(brightest))
    ratio = long / short / own
    return before * ratio, deviation * ratio
