"""Tell whether a scene has changed between two frames, as since it was metered."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from optics.camera import Sensor
from optics.hdr.exposures import ExposureSNR
from optics.validation import require_unmasked

Array = NDArray[np.float64]

# Rows and columns of blocks of a frame: few numbers to keep, and small parts of the scene; chosen
BLOCKS = (8, 8)

# Shares of the pixels, for scenes with bright pixels in each of their blocks; chosen
SHARES = (0.01, 0.05, 0.1, 0.25, 0.5, 0.75, 0.9, 0.95, 0.99)

# Pixels of like light whose mean tells a quantile: noise then is a fifth of a pixel's light; chosen
_ALIKE = 16

_LEVEL_ERROR = 0.3  # digital numbers: black levels are rounded to whole ones; chosen
_LEAST_SNR = 20.0  # of a block that is compared: its light is known to 5 %; chosen
# Logarithm of a ratio: a change of 20 % is told for certain, one of 10 % is not; chosen
_NOTABLE = 0.15
_NOTABLE_SHARE = 0.1  # of the blocks that is told; chosen


@dataclass(frozen=True, eq=False)
class SceneLight:
    """What one or several frames tell of a scene's light, in electrons/s.

    blocks: mean rate of each block, of the shape `BLOCKS`; NaN where a pixel is clipped, or where
    the light isn't known to 5 %. quantiles: rates below which shares of the pixels lie, those of
    `SHARES`; NaN where they are clipped or noise.
    """

    blocks: Array
    quantiles: Array


@dataclass(frozen=True)
class SceneChange:
    """Light of a scene over that of before.

    ratio: of the blocks that are told by both, or of the quantiles, whichever differs more.
    changed_share: of these blocks, those whose own light differs notably. parts: blocks and
    quantiles that were compared.
    """

    ratio: float
    changed_share: float
    parts: int

    @property
    def is_notable(self) -> bool:
        """Whether the light has changed by some 20 %, in all or in part of the scene."""
        return abs(math.log(self.ratio)) > _NOTABLE or self.changed_share > _NOTABLE_SHARE

    def explain(self) -> str:
        """Say in words how the scene has changed."""
        return (
            f"the scene has {self.ratio:.3g} times the light that was metered, and differs in "
            f"{self.changed_share:.0%} of its parts"
        )


def scene_light(frames: Iterable[tuple[float, NDArray[Any]]], sensor: Sensor) -> SceneLight:
    """Return what frames tell of a scene's light, to be compared with that of other frames.

    Parameters
    ----------
    frames : iterable of (float, NDArray)
        Exposure times in seconds, and digital numbers (rows, columns).
    sensor : Sensor
        Tells gain, noise, black level and full scale.

    Returns
    -------
    SceneLight
        Of the frames in which a part isn't clipped, the longest tells it best.
    """
    found = SceneLight(np.full(BLOCKS, np.nan), np.full(len(SHARES), np.nan))
    for time, numbers in sorted(frames, key=lambda one: one[0]):
        require_unmasked(numbers)
        seen = _light_of_frame(np.asarray(numbers), time, sensor)
        found = SceneLight(
            np.where(np.isfinite(seen.blocks), seen.blocks, found.blocks),
            np.where(np.isfinite(seen.quantiles), seen.quantiles, found.quantiles),
        )
    return found


def scene_change(before: SceneLight, after: SceneLight) -> SceneChange:
    """Compare a scene's light with that of before."""
    both = np.isfinite(before.blocks) & np.isfinite(after.blocks)
    first, second = before.blocks[both], after.blocks[both]
    of_quantiles = np.log(after.quantiles / before.quantiles)
    of_quantiles = of_quantiles[np.isfinite(of_quantiles)]
    ratios = [math.log(second.sum() / first.sum())] if both.any() else []
    if of_quantiles.size:
        ratios.append(float(np.median(of_quantiles)))
    farthest = max(ratios, key=abs, default=0.0)
    share = float((np.abs(np.log(second / first)) > _NOTABLE).mean()) if both.any() else 0.0
    return SceneChange(math.exp(farthest), share, int(both.sum()) + len(of_quantiles))


def _light_of_frame(numbers: NDArray[Any], time: float, sensor: Sensor) -> SceneLight:
    """Return what one frame tells of a scene's light."""
    blocks = np.full(BLOCKS, np.nan)
    for place in np.ndindex(BLOCKS):
        part = numbers[
            tuple(
                slice(at * length // count, (at + 1) * length // count)
                for at, count, length in zip(place, BLOCKS, numbers.shape, strict=True)
            )
        ]
        if part.size and not (part >= sensor.full_scale).any():
            blocks[place] = _known_rate(float(part.mean(dtype=np.float64)), part.size, time, sensor)
    quantiles = [
        _known_rate(float(one), _ALIKE, time, sensor) if one < sensor.full_scale else np.nan
        for one in np.quantile(numbers, SHARES)
    ]
    return SceneLight(blocks, np.array(quantiles))


def _known_rate(number: float, pixels: int, time: float, sensor: Sensor) -> float:
    """Return the rate of pixels from their mean number, electrons/s; NaN if it isn't known."""
    light = (number - sensor.black_level) * sensor.gain - sensor.dark_current * time
    noise = math.sqrt((max(light, 0) + ExposureSNR(sensor).floor(time)) / pixels)
    known = light > _LEAST_SNR * math.hypot(noise, _LEVEL_ERROR * sensor.gain)
    return light / time if known else np.nan
