"""Tell whether a scene has changed between two frames, as since an exposure bracket was metered."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from optics.camera import Sensor
from optics.hdr.exposure_snr import ExposureSNR

Array = NDArray[np.float64]

BLOCKS = (8, 8)
"""Rows and columns of blocks into which a frame is divided. Chosen: few numbers to keep, and small
enough that a part of the scene is told apart from the whole."""

_LEVEL_ERROR = 0.3
"""Error of a sensor's black level in digital numbers. Chosen: levels are rounded to whole ones."""

_LEAST_SNR = 20.0
"""Signal over noise of a block from which on it is compared: its light is known to 5 %. Chosen."""

_NOTABLE = 0.15
"""Logarithm of the ratio of lights from which on a change is told: a change of 20 % is told for
certain, one of 10 % is not. Chosen."""

_NOTABLE_SHARE = 0.1
"""Share of the blocks that is told. Chosen."""


@dataclass(frozen=True)
class SceneChange:
    """Light of a scene over that of before.

    ratio: of all blocks that are bright and unclipped in both. changed_share: of these blocks,
    those whose own light differs notably. blocks: their number.
    """

    ratio: float
    changed_share: float
    blocks: int

    @property
    def is_notable(self) -> bool:
        """Whether an HDR scene's light has changed by some 20 %, in all or in part of it."""
        return self.blocks > 0 and (
            abs(math.log(self.ratio)) > _NOTABLE or self.changed_share > _NOTABLE_SHARE
        )

    def explain(self) -> str:
        """Say in words how an HDR scene has changed."""
        return (
            f"the scene has {self.ratio:.3g} times the light that was metered, and differs in "
            f"{self.changed_share:.0%} of its parts"
        )


def block_rates(numbers: NDArray[np.generic], time: float, sensor: Sensor) -> Array:
    """Return the mean rate of each block of an HDR scene's frame, in electrons/s.

    Parameters
    ----------
    numbers : NDArray
        (rows, columns) digital numbers.
    time : float
        Exposure time in seconds.
    sensor : Sensor
        Tells gain, noise, black level and full scale.

    Returns
    -------
    NDArray
        Of the shape `BLOCKS`; NaN where a pixel is clipped, or where the light isn't known to 5 %.
    """
    flat = np.asarray(numbers)
    found = np.full(BLOCKS, np.nan)
    floor = ExposureSNR(sensor).floor(time)
    for place in np.ndindex(BLOCKS):
        part = flat[tuple(_part(place[axis], axis, flat.shape) for axis in (0, 1))]
        if not part.size or (part >= sensor.full_scale).any():
            continue
        mean = float(part.mean(dtype=np.float64)) - sensor.black_level
        light = mean * sensor.gain - sensor.dark_current * time
        noise = math.sqrt((max(light, 0) + floor) / part.size)
        if light > _LEAST_SNR * math.hypot(noise, _LEVEL_ERROR * sensor.gain):
            found[place] = light / time
    return found


def combined_block_rates(
    frames: Iterable[tuple[float, NDArray[np.generic]]], sensor: Sensor
) -> Array:
    """Return the mean rate of each block of an HDR scene from several frames, as `block_rates`.

    frames: exposure times in seconds, and digital numbers. Of the frames in which a block is
    unclipped, the longest tells most.
    """
    found = np.full(BLOCKS, np.nan)
    for time, numbers in sorted(frames, key=lambda one: one[0]):
        seen = block_rates(numbers, time, sensor)
        found = np.where(np.isfinite(seen), seen, found)
    return found


def scene_change(before: Sequence[Sequence[float]] | Array, after: Array) -> SceneChange:
    """Compare an HDR scene's light in blocks, as `block_rates` returns it, with that of before."""
    first, second = np.asarray(before, dtype=np.float64), np.asarray(after, dtype=np.float64)
    both = np.isfinite(first) & np.isfinite(second)
    if not both.any():
        return SceneChange(1.0, 0.0, 0)
    ratio = float(second[both].sum() / first[both].sum())
    each = np.abs(np.log(second[both] / first[both])) > _NOTABLE
    return SceneChange(ratio, float(each.mean()), int(both.sum()))


def _part(number: int, axis: int, shape: tuple[int, ...]) -> slice:
    """Return the rows, or columns, of one of an HDR frame's blocks."""
    count, length = BLOCKS[axis], shape[axis]
    return slice(number * length // count, (number + 1) * length // count)
