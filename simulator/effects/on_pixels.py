"""How many electrons pixels hold at most, and what a change of them does to what is read."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from optics.camera import Sensor
from optics.sensor import Stages
from optics.sensor.table import pieces
from simulator.effects.keeping import once
from simulator.effects.limits import contrast, densest, energy, known, straight
from simulator.planning import Bound, Stage
from simulator.recipe import Recipe
from simulator.situation import Situation

_GAIN = 1.1
"""Audited: light that orders, or an uneven lamp, may add to a pixel's."""

_SWITCH = 1.01
"""Audited: means and variances bend so much more where a normal distribution takes over from
Poisson's."""

_UNEVEN = 3.0
"""Audited: dim pixels may change by so much more of theirs than all do on the average."""

FURTHEST = 4.5
"""Standard deviations of the response and offset of pixels, at most."""


class PixelStage(Stage):
    """A stage that is done to each pixel by itself, in so many operations."""

    operations: ClassVar[float] = 1.0

    def work(self, s: Situation, levels: Mapping[str, int]) -> float:
        return self.operations * pixels(s) if levels[self.name] else 0.0


def pixels(s: Situation) -> int:
    rows, columns = s.camera.sensor.shape
    return rows * columns


def root_pixels(s: Situation) -> float:
    return math.sqrt(pixels(s))


def flickers(s: Situation) -> bool:
    """Whether the lamp's light isn't steady."""
    return s.target.lamp is not None and not s.target.lamp.constant


def ripple(s: Situation) -> float:
    """The most that the lamp's light differs from its mean, relative to that."""
    return s.target.lamp.ripple if s.target.lamp is not None else 0.0


def seconds(s: Situation) -> float:
    """Of the lamp's mean light, at most, that a pixel sees."""
    return s.exposure * (1 + ripple(s))


def sharp(s: Situation) -> float:
    """L2 norm of the picture's electrons at most, however blurred: no blur adds light (Young)."""
    return float(s.picture.l2) * seconds(s)


def whole(s: Situation) -> float:
    """Electrons over frame and margin, without any blur."""
    return s.picture.whole * seconds(s)


@once
def _densest(s: Situation) -> float:
    """Electrons of the light on a pixel, at most, as its PSFs blur it: by Young, by the brightest
    place of a PSF, and by frequency."""
    sharpest = float(s.picture.brightest) * seconds(s)
    if not known(s):
        return sharpest
    sharpest = min(sharpest, straight(s) * sharpest + beside(s))
    in_phase = s.picture.power.highest(lambda k: contrast(s, k)) * seconds(s) + beside(s)
    return min(sharpest, densest(s) * (whole(s) + beside(s)), in_phase)


def beside(s: Situation) -> float:
    """Electrons of stars beside what is looked at of the picture."""
    return s.picture.beside * seconds(s)


@once
def light(s: Situation) -> float:
    """L2 norm of the picture's electrons at most, as its PSFs blur it: by Young; by the brightest
    pixel and the sum of all; and by frequency (Parseval)."""
    if not known(s):
        return sharp(s)
    summed = math.sqrt(energy(s)) * (whole(s) + beside(s))
    resolved = s.picture.power.changed(lambda k: contrast(s, k)) * seconds(s) + beside(s)
    return min(sharp(s), summed, resolved)


def dark(s: Situation) -> float:
    """Electrons of dark current on an ordinary pixel."""
    return s.camera.sensor.dark_current * s.exposure


def hot_norm(s: Situation) -> float:
    """L2 norm of hot pixels' electrons, with five standard deviations of how many they are."""
    sensor = s.camera.sensor
    return sensor.hot_current * s.exposure * math.sqrt(at_most(sensor.hot, pixels(s)))


def at_most(share: float, count: int) -> float:
    """How many of `count` pixels are among those of a share, with five standard deviations."""
    expected = share * count
    return min(float(count), expected + 5 * math.sqrt(expected)) if share else 0.0


def brightest(s: Situation) -> float:
    """Electrons of the brightest pixel at most, hot ones included."""
    sensor = s.camera.sensor
    lit = _densest(s) * (1 + FURTHEST * sensor.prnu)
    return lit + dark(s) + (sensor.hot_current * s.exposure if sensor.hot else 0.0)


def held(s: Situation) -> float:
    """L2 norm of all electrons on pixels, at most."""
    gain = 1 + FURTHEST * s.camera.sensor.prnu
    return light(s) * gain + dark(s) * root_pixels(s) + hot_norm(s)


def limit(sensor: Sensor) -> float:
    """Electrons from which well or converter may clip, but for shot noise."""
    spread = 7 * sensor.read_noise + FURTHEST * sensor.dsnu
    top = (2**sensor.bits - 1 - sensor.black_level) * sensor.gain
    return max(min(sensor.full_well, top - spread), 0.0)


def near_limit(s: Situation) -> bool:
    """Whether any pixel can come within seven standard deviations of being clipped."""
    most = brightest(s)
    return most + 7 * math.sqrt(most) + 20 > limit(s.camera.sensor)


def deep(s: Situation, recipe: Recipe) -> Recipe:
    """The same with wells and a converter without an end, where any may be full: what a full well
    clips counts as before it does (see simulator.effects.floor)."""
    return recipe.having(clipping=False) if near_limit(s) else recipe


def safe(s: Situation) -> float:
    """Electrons of light up to which seven standard deviations clip nothing."""
    free = max(limit(s.camera.sensor) - 20 - dark(s), 0.0)
    # x + 7 √x is what is left of the well.
    root = max(math.sqrt(free + 12.25) - 3.5, 0.0)
    return root**2 / (1 + FURTHEST * s.camera.sensor.prnu)


@dataclass(frozen=True)
class Full:
    """Pixels with more light than is safe, at most: their number, the sum of their electrons, and
    of these squared."""

    count: float
    total: float
    energy: float


@once
def full(s: Situation) -> Full:
    """Which wells may be full.

    However blurred, a picture has no more of (m - θ)₊ and its square than the sharp one, for any
    θ (Jensen: a blur is a mean). Where m is above W > θ, m is at most W / (W - θ) of m - θ.
    """
    if not near_limit(s):
        return Full(0.0, 0.0, 0.0)
    count, well = float(pixels(s)), safe(s)
    total, energy = whole(s) + beside(s), light(s) ** 2
    if well <= 0:
        return Full(count, total, energy)
    if not s.picture.beside:
        for share in (0.5, 0.7, 0.8, 0.9):
            over = s.picture.over(share * well / seconds(s))
            factor = _GAIN * seconds(s) / (1 - share)
            total = min(total, factor * over[0])
            energy = min(energy, factor**2 * over[1])
    sensor = s.camera.sensor
    hot = at_most(sensor.hot, pixels(s)) if sensor.hot_current else 0.0
    return Full(min(count, energy / well**2 + hot, total / well + hot), total, energy)


def near_zero(sensor: Sensor) -> bool:
    """Whether noise and offsets of a dark pixel can reach the converter's lower end."""
    room = sensor.black_level * sensor.gain - FURTHEST * sensor.dsnu
    return room < 8 * sensor.read_noise + sensor.gain


def through_sensor(s: Situation, change: float, how: str, *, read_noise: bool = True) -> Bound:
    """What a change of the picture's electrons does to mean, variance and σ of what is read.

    change: L2 norm, electrons over the exposure. Mean and variance change by the steepest that
    they are of electrons anywhere up to the brightest pixel, with read noise. What a full well
    clips counts as before it is clipped (see floor()). σ:
    |√a - √b| is |a - b| over the sum of both, of which read noise and the light of the dim tenth
    of the picture are the least (audited: a change is no larger in the dark), and at most
    √|a - b|, whose squares add up to no more than √pixels times the change (Cauchy-Schwarz).
    read_noise: whether it may be counted on; without it, few electrons more make much of σ.
    """
    sensor, most = s.camera.sensor, _round(brightest(s))
    mean, variance, least = _steepest(sensor, most, min(most, float(round(safe(s)))))
    varied = variance * change
    sigma = math.sqrt(varied * root_pixels(s))
    if read_noise and least:
        sigma = min(sigma, varied / (2 * math.hypot(least, math.sqrt(_dim(s)))))
    return Bound(mean * change, varied, sigma, how=how)


def in_proportion(s: Situation, change: float, how: str, uneven: float = _UNEVEN) -> Bound:
    """through_sensor() of a change that goes with the light that is there: dark pixels change no
    more of theirs than bright ones do, or by a factor `uneven`.

    Where m changes by a share ε of it, √(m + r²) changes by no more than ε √m / 2, whatever the
    read noise: over all pixels by ε/2 of the root of all light.
    """
    bound = through_sensor(s, change, how)
    norm = light(s)
    if not norm:
        return bound
    root = math.sqrt(bound.variance / change * (whole(s) + beside(s))) if change else 0.0
    sigma = min(bound.sigma, uneven * change / norm / 2 * root)
    return replace(bound, sigma=sigma)


def _dim(s: Situation) -> float:
    """Electrons that pixels hold where a change counts, at least: as much as the dim tenth of the
    sharp picture has, and half of that, for it may be dimmer there."""
    return 0.5 * s.picture.dim * s.exposure


def _round(electrons: float) -> float:
    return 2.0 ** math.ceil(math.log2(max(electrons, 64.0)))


@functools.lru_cache(maxsize=64)
def _steepest(sensor: Sensor, most: float, kept: float) -> tuple[float, float, float]:
    """Largest slopes of mean and variance by electrons, and the least σ with read noise.

    kept: electrons up to which nothing is clipped at the upper end. Beyond, unclipped steps of
    the converter (g electrons) make slopes wavy by exp(-2 pi² m / g²) of m electrons (Widrow),
    which is nothing from g² on.
    """
    slopes, least = [], math.inf
    rounded = min(most, _round(sensor.gain**2))
    for stages, end in (
        (Stages(clipping=clipping, quantisation=quantisation), kept if clipping else rounded)
        for clipping in (True, False)
        for quantisation in (True, False)
    ):
        for table in pieces(sensor, stages, end):
            slopes.append(table.steepest(end))
            least = min(least, table.least(end))
    mean, variance = np.array(slopes).max(axis=0)
    return (
        _SWITCH * max(float(mean), 1.0),
        _SWITCH * max(float(variance), 1.0),
        math.sqrt(least) if sensor.read_noise else 0.0,
    )
