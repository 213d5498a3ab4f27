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
from optics.sensor.moment_table import moment_tables
from simulator.effects.psf_bounds import (
    has_known_psf,
    mtf_bound,
    peak_pixel_share,
    psf_energy_bound,
    zeroth_order_share,
)
from simulator.effects.result_cache import cached_per_situation
from simulator.planning import Bound, OnOffEffect
from simulator.recipe import Recipe
from simulator.situation import Situation

_GAIN = 1.1
"""Audited: light that orders, or an uneven lamp, may add to a pixel's."""

_SWITCH = 1.01
"""Audited: means and variances bend so much more where a normal distribution takes over from
Poisson's."""

_UNEVEN = 3.0
"""Audited: dim pixels may change by so much more of theirs than all do on the average."""

MAX_PIXEL_SIGMAS = 4.5
"""Standard deviations of the response and offset of pixels, at most."""


class PixelwiseEffect(OnOffEffect):
    """A stage that is done to each pixel by itself, in so many operations."""

    operations_per_pixel: ClassVar[float] = 1.0

    def work(self, s: Situation, levels: Mapping[str, int]) -> float:
        return self.operations_per_pixel * pixel_count(s) if levels[self.name] else 0.0


def pixel_count(s: Situation) -> int:
    rows, columns = s.camera.sensor.shape
    return rows * columns


def sqrt_pixel_count(s: Situation) -> float:
    return math.sqrt(pixel_count(s))


def is_lamp_flickering(s: Situation) -> bool:
    """Whether the lamp's light isn't steady."""
    return s.target.lamp is not None and not s.target.lamp.is_constant


def lamp_ripple(s: Situation) -> float:
    """The most that the lamp's light differs from its mean, relative to that."""
    return s.target.lamp.ripple if s.target.lamp is not None else 0.0


def max_lamp_seconds(s: Situation) -> float:
    """Of the lamp's mean light, at most, that a pixel sees."""
    return s.exposure * (1 + lamp_ripple(s))


def sharp_norm_bound(s: Situation) -> float:
    """L2 norm of the picture's electrons at most, however blurred: no blur adds light (Young)."""
    return float(s.picture_probe.norm_bound) * max_lamp_seconds(s)


def total_electrons(s: Situation) -> float:
    """Electrons over frame and margin, without any blur."""
    return s.picture_probe.total_with_margin * max_lamp_seconds(s)


@cached_per_situation
def _peak_light_electrons(s: Situation) -> float:
    """Electrons of the light on a pixel, at most, as its PSFs blur it: by Young, by the brightest
    place of a PSF, and by frequency."""
    sharpest = float(s.picture_probe.brightest) * max_lamp_seconds(s)
    if not has_known_psf(s):
        return sharpest
    sharpest = min(sharpest, zeroth_order_share(s) * sharpest + off_plane_star_electrons(s))
    in_phase = s.picture_probe.power_spectrum.filtered_peak_bound(
        lambda k: mtf_bound(s, k)
    ) * max_lamp_seconds(s) + off_plane_star_electrons(s)
    return min(
        sharpest, peak_pixel_share(s) * (total_electrons(s) + off_plane_star_electrons(s)), in_phase
    )


def off_plane_star_electrons(s: Situation) -> float:
    """Electrons of stars beside what is looked at of the picture."""
    return s.picture_probe.off_plane_star_rate * max_lamp_seconds(s)


@cached_per_situation
def light_norm_bound(s: Situation) -> float:
    """L2 norm of the picture's electrons at most, as its PSFs blur it: by Young; by the brightest
    pixel and the sum of all; and by frequency (Parseval)."""
    if not has_known_psf(s):
        return sharp_norm_bound(s)
    summed = math.sqrt(psf_energy_bound(s)) * (total_electrons(s) + off_plane_star_electrons(s))
    resolved = s.picture_probe.power_spectrum.filtered_norm_bound(
        lambda k: mtf_bound(s, k)
    ) * max_lamp_seconds(s) + off_plane_star_electrons(s)
    return min(sharp_norm_bound(s), summed, resolved)


def dark_current_electrons(s: Situation) -> float:
    """Electrons of dark current on an ordinary pixel."""
    return s.camera.sensor.dark_current * s.exposure


def hot_pixel_norm(s: Situation) -> float:
    """L2 norm of hot pixels' electrons, with five standard deviations of how many they are."""
    sensor = s.camera.sensor
    return (
        sensor.hot_current
        * s.exposure
        * math.sqrt(affected_pixel_bound(sensor.hot, pixel_count(s)))
    )


def affected_pixel_bound(share: float, count: int) -> float:
    """How many of `count` pixels are among those of a share, with five standard deviations."""
    expected = share * count
    return min(float(count), expected + 5 * math.sqrt(expected)) if share else 0.0


def peak_electrons(s: Situation) -> float:
    """Electrons of the brightest pixel at most, hot ones included."""
    sensor = s.camera.sensor
    lit = _peak_light_electrons(s) * (1 + MAX_PIXEL_SIGMAS * sensor.prnu)
    return (
        lit + dark_current_electrons(s) + (sensor.hot_current * s.exposure if sensor.hot else 0.0)
    )


def electron_norm_bound(s: Situation) -> float:
    """L2 norm of all electrons on pixels, at most."""
    gain = 1 + MAX_PIXEL_SIGMAS * s.camera.sensor.prnu
    return (
        light_norm_bound(s) * gain
        + dark_current_electrons(s) * sqrt_pixel_count(s)
        + hot_pixel_norm(s)
    )


def clipping_onset(sensor: Sensor) -> float:
    """Electrons from which well or converter may clip, but for shot noise."""
    spread = 7 * sensor.read_noise + MAX_PIXEL_SIGMAS * sensor.dsnu
    top = (2**sensor.bits - 1 - sensor.black_level) * sensor.gain
    return max(min(sensor.full_well, top - spread), 0.0)


def can_clip(s: Situation) -> bool:
    """Whether any pixel can come within seven standard deviations of being clipped."""
    most = peak_electrons(s)
    return most + 7 * math.sqrt(most) + 20 > clipping_onset(s.camera.sensor)


def without_clipping(s: Situation, recipe: Recipe) -> Recipe:
    """The same with wells and a converter without an end, where any may be full: what a full well
    clips counts as before it does (see simulator.effects.picture_norms)."""
    return recipe.with_changes(clipping=False) if can_clip(s) else recipe


def unclipped_light(s: Situation) -> float:
    """Electrons of light up to which seven standard deviations clip nothing."""
    free = max(clipping_onset(s.camera.sensor) - 20 - dark_current_electrons(s), 0.0)
    # x + 7 √x is what is left of the well.
    root = max(math.sqrt(free + 12.25) - 3.5, 0.0)
    return root**2 / (1 + MAX_PIXEL_SIGMAS * s.camera.sensor.prnu)


@dataclass(frozen=True)
class FullWells:
    """Pixels with more light than is safe, at most: their number, the sum of their electrons, and
    of these squared."""

    count: float
    total: float
    energy: float


@cached_per_situation
def full_well_bounds(s: Situation) -> FullWells:
    """Which wells may be full.

    However blurred, a picture has no more of (m - θ)₊ and its square than the sharp one, for any
    θ (Jensen: a blur is a mean). Where m is above W > θ, m is at most W / (W - θ) of m - θ.
    """
    if not can_clip(s):
        return FullWells(0.0, 0.0, 0.0)
    count, well = float(pixel_count(s)), unclipped_light(s)
    total, energy = total_electrons(s) + off_plane_star_electrons(s), light_norm_bound(s) ** 2
    if well <= 0:
        return FullWells(count, total, energy)
    if not s.picture_probe.off_plane_star_rate:
        for share in (0.5, 0.7, 0.8, 0.9):
            over = s.picture_probe.excess_over(share * well / max_lamp_seconds(s))
            factor = _GAIN * max_lamp_seconds(s) / (1 - share)
            total = min(total, factor * over[0])
            energy = min(energy, factor**2 * over[1])
    sensor = s.camera.sensor
    hot = affected_pixel_bound(sensor.hot, pixel_count(s)) if sensor.hot_current else 0.0
    return FullWells(min(count, energy / well**2 + hot, total / well + hot), total, energy)


def can_clip_at_zero(sensor: Sensor) -> bool:
    """Whether noise and offsets of a dark pixel can reach the converter's lower end."""
    room = sensor.black_level * sensor.gain - MAX_PIXEL_SIGMAS * sensor.dsnu
    return room < 8 * sensor.read_noise + sensor.gain


def sensor_error_bound(s: Situation, change: float, how: str, *, read_noise: bool = True) -> Bound:
    """What a change of the picture's electrons does to mean, variance and σ of what is read.

    change: L2 norm, electrons over the exposure. Mean and variance change by the steepest that
    they are of electrons anywhere up to the brightest pixel, with read noise. What a full well
    clips counts as before it is clipped (see minimum_norms()). σ:
    |√a - √b| is |a - b| over the sum of both, of which read noise and the light of the dim tenth
    of the picture are the least (audited: a change is no larger in the dark), and at most
    √|a - b|, whose squares add up to no more than √pixels times the change (Cauchy-Schwarz).
    read_noise: whether it may be counted on; without it, few electrons more make much of σ.
    """
    sensor, most = s.camera.sensor, _next_power_of_two(peak_electrons(s))
    mean, variance, least = _steepest_slopes(
        sensor, most, min(most, float(round(unclipped_light(s))))
    )
    varied = variance * change
    sigma = math.sqrt(varied * sqrt_pixel_count(s))
    if read_noise and least:
        sigma = min(sigma, varied / (2 * math.hypot(least, math.sqrt(_dim_pixel_electrons(s)))))
    return Bound(mean * change, varied, sigma, how=how)


def proportional_error_bound(
    s: Situation, change: float, how: str, dim_pixel_margin: float = _UNEVEN
) -> Bound:
    """sensor_error_bound() of a change that goes with the light that is there.

    Dark pixels change no more of theirs than bright ones do, or by a factor `dim_pixel_margin`.

    Where m changes by a share ε of it, √(m + r²) changes by no more than ε √m / 2, whatever the
    read noise: over all pixels by ε/2 of the root of all light.
    """
    bound = sensor_error_bound(s, change, how)
    norm = light_norm_bound(s)
    if not norm:
        return bound
    root = (
        math.sqrt(bound.variance / change * (total_electrons(s) + off_plane_star_electrons(s)))
        if change
        else 0.0
    )
    sigma = min(bound.sigma, dim_pixel_margin * change / norm / 2 * root)
    return replace(bound, sigma=sigma)


def _dim_pixel_electrons(s: Situation) -> float:
    """Electrons that pixels hold where a change counts, at least: as much as the dim tenth of the
    sharp picture has, and half of that, for it may be dimmer there."""
    return 0.5 * s.picture_probe.dim_decile * s.exposure


def _next_power_of_two(electrons: float) -> float:
    return 2.0 ** math.ceil(math.log2(max(electrons, 64.0)))


@functools.lru_cache(maxsize=64)
def _steepest_slopes(
    sensor: Sensor, most: float, unclipped_electrons: float
) -> tuple[float, float, float]:
    """Largest slopes of mean and variance by electrons, and the least σ with read noise.

    unclipped_electrons: up to which nothing is clipped at the upper end. Beyond, unclipped steps
    of the converter (g electrons) make slopes wavy by exp(-2 pi² m / g²) of m electrons (Widrow),
    which is nothing from g² on.
    """
    slopes, least = [], math.inf
    rounded = min(most, _next_power_of_two(sensor.gain**2))
    for stages, end in (
        (
            Stages(clipping=clipping, quantisation=quantisation),
            unclipped_electrons if clipping else rounded,
        )
        for clipping in (True, False)
        for quantisation in (True, False)
    ):
        for table in moment_tables(sensor, stages, end):
            slopes.append(table.max_slopes(end))
            least = min(least, table.min_variance(end))
    mean, variance = np.array(slopes).max(axis=0)
    return (
        _SWITCH * max(float(mean), 1.0),
        _SWITCH * max(float(variance), 1.0),
        math.sqrt(least) if sensor.read_noise else 0.0,
    )
