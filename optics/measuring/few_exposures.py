"""Black level, linearity and clip level of a camera from few frames.

Repeated frames tell a lamp that flickers from a camera that isn't linear.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from optics.measuring.measured import Measured
from optics.sensor.readout import LEAST_PILE, top_pile

Array = NDArray[np.float64]


# Deviations by which the brightest pixels rise where there is light; all numbers are chosen
_SEEN_RISE = 8.0
# Light by the shorter exposure over the longer one's largest number: clipped there
_SURELY_CLIPPED = 1.3
_SURELY_OPEN = 0.9  # number of a pixel over the largest one, up to which it surely isn't clipped
# Deviation of clipped numbers: DN where a converter ends, share where wells are full
_SAME_NUMBER, _SAME_LEVEL = 0.6, 0.03
_WELL_DEVIATIONS = 5.0  # deviations below the mean full well from which a pixel counts as clipped
# Pixels that tell the linearity, and their signal over noise, at least
_LEAST_PIXELS, _LEAST_SNR = 30, 4.0
_CUT = 0.02  # share of pixels at 0 from which on darkness is cut off
_GROUPS = 8  # parts of the pixels whose scatter tells how sure a result is


@dataclass(frozen=True)
class SeenClip:
    """Where pixels clip, DN, what ends there, and how many pixels showed it."""

    number: int
    limit: Literal["converter", "well"]
    pixels: int


@dataclass(frozen=True)
class Linearity:
    """How numbers rise with the exposure.

    exponent: power of the exposure with which light rises, 1 if it is linear.
    exposures: seconds, those that told it.
    pixels: their number.
    """

    exponent: Measured
    exposures: tuple[float, float, float]
    pixels: int


class FewExposures:
    """What frames of one scene, one of each exposure, tell of a camera.

    exposures: seconds, in rising order, each some times the last.
    images: (rows, columns).
    """

    def __init__(self, exposures: Sequence[float], images: Sequence[NDArray[np.generic]]) -> None:
        if len(exposures) != len(images) or len(exposures) < 2:
            raise ValueError(f"{len(exposures)} exposures of {len(images)} frames; give two each")
        if not np.all(np.diff(exposures) > 0):
            raise ValueError(f"exposures are {list(exposures)}; they must rise from frame to frame")
        self._times = list(exposures)
        self._images = [np.asarray(image, dtype=np.float64).reshape(-1) for image in images]

    @cached_property
    def top(self) -> float:
        """The largest number in any frame."""
        return max(float(image.max()) for image in self._images)

    @cached_property
    def share_at_zero(self) -> float:
        """Share of the pixels at 0 in the shortest exposure."""
        return float(np.mean(self._images[0] == 0))

    @property
    def is_cut_at_zero(self) -> bool:
        """Whether darkness ends at 0, so that its noise is cut off below."""
        return self.share_at_zero > _CUT

    @cached_property
    def sees_light(self) -> bool:
        """Whether the brightest pixels rise with the exposure."""
        first, last = self._images[0], self._images[-1]
        chosen = last >= np.quantile(last, 1 - min(0.5, LEAST_PILE / last.size))
        # The lower half of the shortest exposure, where light is least, tells the noise.
        low, middle = np.quantile(first, [0.16, 0.5])
        noise = float(middle - low) * math.sqrt(2.0)
        # The brightest pixels by chance lie some deviations above the others.
        return bool((last[chosen] - first[chosen]).mean() > _SEEN_RISE * max(noise, 0.3))

    @cached_property
    def black_level(self) -> Measured:
        """The mean number at no exposure, in DN, by the two shortest ones."""
        (short, long), (a, b) = self._times[:2], self._images[:2]
        open_ = b <= (self.top + float(np.median(a))) / 2
        if not open_.any():
            open_ = np.ones_like(open_)
        low, high = a[open_], b[open_]
        share = short / (long - short)
        pixels = low - (high - low) * share
        return Measured(float(pixels.mean()), float(pixels.std() / math.sqrt(pixels.size)))

    @cached_property
    def clip(self) -> SeenClip | None:
        """Where pixels clip; None if the exposures don't show it."""
        found = (self._clip_of(number) for number in reversed(range(1, len(self._images))))
        return next((one for one in found if one is not None), None)

    def _clip_of(self, number: int) -> SeenClip | None:
        """Return the clip level that an exposure shows beside the shorter one before it."""
        a, b, black = self._images[number - 1], self._images[number], self.black_level.value
        room = float(b.max()) - black
        light = (a - black) * (self._times[number] / self._times[number - 1])
        # These pixels must be clipped by the shorter exposure.
        chosen = (light > _SURELY_CLIPPED * room) & (a - black < _SURELY_OPEN * room)
        count = int(np.count_nonzero(chosen))
        if count >= LEAST_PILE:
            level, spread = float(np.median(b[chosen])), float(b[chosen].std())
            if spread < _SAME_NUMBER:
                return SeenClip(round(level), "converter", count)
            if spread < _SAME_LEVEL * (level - black):
                return SeenClip(math.floor(level - _WELL_DEVIATIONS * spread), "well", count)
        # Otherwise pixels that pile up at a number that the longer exposure keeps.
        pile = top_pile(b)
        if pile is None or pile != a.max() or not self.sees_light:
            return None
        return SeenClip(pile, "converter", int(np.count_nonzero(b == pile)))

    @cached_property
    def linearity(self) -> Linearity | None:
        """How numbers rise over three exposures; None if there is too little light."""
        found = (self._linearity(number) for number in reversed(range(2, len(self._images))))
        return next((one for one in found if one is not None), None)

    def _linearity(self, number: int) -> Linearity | None:
        """Return the linearity over an exposure and the two before it, if light tells it.

        Differences are compared, so that the black level plays no part: for light that rises with
        the power p of exposures t, (y3 - y2) / (y2 - y1) is (t3/t2)^p if each t is as many times
        the last.
        """
        t1, t2, t3 = self._times[number - 2 : number + 1]
        a, b, c = self._images[number - 2 : number + 1]
        black, top = float(a.min()), float(self.top if self.clip is None else self.clip.number)
        chosen = (c - black < _SURELY_OPEN * (top - black)) & (c < top)
        if not chosen.any():
            return None
        chosen &= c - black > 0.3 * (float(c[chosen].max()) - black)
        first, second = (b - a)[chosen], (c - b)[chosen]
        if first.size < _LEAST_PIXELS:
            return None
        noise = float(np.std(second - first * second.mean() / first.mean())) if first.mean() else 0
        if first.mean() <= 0 or second.mean() < _LEAST_SNR * noise:
            return None
        even, ratio = (t3 - t2) / (t2 - t1), t2 / t1
        parts = [
            second[part::_GROUPS].mean() / first[part::_GROUPS].mean() for part in range(_GROUPS)
        ]
        if min(parts) <= 0:
            return None
        powers = 1 + np.log(np.array(parts) / even) / math.log(ratio)
        value = 1 + math.log(second.mean() / first.mean() / even) / math.log(ratio)
        exponent = Measured(value, float(powers.std(ddof=1)) / math.sqrt(_GROUPS))
        return Linearity(exponent, (t1, t2, t3), first.size)


_SIGMAS = 4.0  # deviations beyond their noise by which frames differ where the lamp flickers


@dataclass(frozen=True)
class RepeatedLinearity:
    """How numbers rise with the exposure, in the mean of repeated frames.

    exponent: power of the exposure, 1 if it is linear; its deviation holds the lamp's.
    flicker: deviation of the light from frame to frame of one exposure, relative, 0 where noise
        explains it.
    """

    exponent: Measured
    flicker: float


def repeated_linearity(
    exposures: Sequence[float], repeats: Sequence[Sequence[NDArray[np.generic]]]
) -> RepeatedLinearity | None:
    """Return the linearity by several frames of each of three exposures; None if it is dark.

    A lamp that flickers gives each frame another light. Its mean stays, and how much the result
    depends on single frames tells how well it is known (the jackknife of Quenouille and Tukey).
    """
    frames = [np.asarray(group, dtype=np.float64) for group in repeats]
    count = min(len(group) for group in frames)
    whole = FewExposures(exposures, [group.mean(axis=0) for group in frames])
    if whole.linearity is None or count < 3:
        return None
    left = []
    for number in range(count):
        rest = [np.delete(one, number, 0).mean(axis=0) for one in frames]
        found = FewExposures(exposures, rest).linearity
        if found is None:
            return None
        left.append(found.exponent.value)
    scatter = (count - 1) / count * float(np.sum((np.array(left) - np.mean(left)) ** 2))
    flicker = max(frame_flicker(group, whole.black_level.value) for group in frames)
    seen = whole.linearity.exponent
    return RepeatedLinearity(Measured(seen.value, math.hypot(seen.sigma, scatter**0.5)), flicker)


def frame_flicker(images: Sequence[NDArray[np.generic]] | Array, black: float) -> float:
    """Return how much the light of frames of one exposure differs, relative.

    black: level of darkness in DN. The result is 0 where noise explains the difference.
    """
    frames = np.asarray(images, dtype=np.float64)
    mean = frames.mean(axis=0)
    bright = mean - black > (float(np.quantile(mean, 0.999)) - black) / 2
    if not bright.any() or (light := float(mean[bright].mean()) - black) <= 0:
        return 0.0
    levels = frames[:, bright].mean(axis=1)
    # What all pixels have in common isn't their noise.
    alone = frames[:, bright] - levels[:, None]
    noise = float(alone.std(axis=0, ddof=1).mean()) / math.sqrt(bright.sum())
    deviation = float(levels.std(ddof=1))
    return deviation / light if deviation > _SIGMAS * noise else 0.0
