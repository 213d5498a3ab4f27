"""Bounds of the electrons on pixels, and of what a change of them does to the frame's numbers."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np

from optics.camera import Camera, Sensor
from optics.camera.ghost import total_share
from optics.sensor import Stages
from optics.sensor.moments import moment_tables
from simulator.effects.psf_bounds import (
    has_known_psf,
    mtf_bound,
    peak_pixel_share,
    psf_energy_bound,
    zeroth_order_share,
)
from simulator.effects.result_cache import cached_per_situation
from simulator.formation.distorting import moved_frame
from simulator.planning import Bound, OnOffEffect
from simulator.recipe import Recipe
from simulator.situation import Situation
from simulator.speckle import speckle_variance

MAX_PIXEL_SIGMAS = 4.5
"""Largest deviation of a pixel's response and offset, in standard deviations."""

# Largest relative change of a dim pixel over that of the whole picture, from audits.
_DIM_PIXEL_MARGIN = 3.0


class PixelwiseEffect(OnOffEffect):
    """A stage of the sensor that treats each pixel by itself, for so many operations."""

    operations_per_pixel: ClassVar[float] = 1.0

    def added_operations(self, s: Situation, levels: Mapping[str, int]) -> float:
        return self.operations_per_pixel * pixel_count(s) if levels[self.name] else 0.0


def pixel_count(s: Situation) -> int:
    """Return the sensor's number of pixels."""
    rows, columns = s.camera.sensor.shape
    return rows * columns


def sqrt_pixel_count(s: Situation) -> float:
    """Return the square root of the pixel count, which turns a pixel's change into an L2 norm."""
    return math.sqrt(pixel_count(s))


def is_lamp_flickering(s: Situation) -> bool:
    """Whether the lamp's light changes with time."""
    return s.target.lamp is not None and not s.target.lamp.is_constant


def lamp_ripple(s: Situation) -> float:
    """Return the largest relative deviation of the lamp's light from its mean."""
    return s.target.lamp.ripple if s.target.lamp is not None else 0.0


def max_light_seconds(s: Situation) -> float:
    """Bound an exposure's light, in seconds of the lamp's mean light on ideal pixels."""
    brighter = area_change(s) * ghost_gain(s.camera)
    return s.exposure * (1 + lamp_ripple(s)) * max_panel_power(s) * brighter


def ghost_gain(camera: Camera) -> float:
    """Return by how much a lens' ghosts brighten even light at most: smaller ones are denser."""
    kept = 1 - total_share(camera.ghosts)
    return max(1.0, kept + sum(one.brightness for one in camera.ghosts))


def area_change(s: Situation) -> float:
    """Return by how much the lens changes areas at most; as much denser may their light be."""
    frame = moved_frame(s)
    return max(frame.largest, 1 / frame.least)


def max_panel_power(s: Situation) -> float:
    """Bound a PSF's light over that of ideal pixels, to which gaps and interference may add."""
    return s.pattern_probe.max_relative_power * (1 + abs(s.interference))


def sharp_norm_bound(s: Situation) -> float:
    """Bound the L2 norm of the picture's electrons under any blur, which adds no light (Young)."""
    return float(s.picture_probe.norm_bound) * max_light_seconds(s)


def total_electrons(s: Situation) -> float:
    """Return the unblurred picture's electrons, with a margin."""
    return s.picture_probe.total_with_margin * max_light_seconds(s)


def off_plane_star_electrons(s: Situation) -> float:
    """Return the electrons of stars outside the probed picture."""
    return s.picture_probe.off_plane_star_rate * max_light_seconds(s)


def all_electrons(s: Situation) -> float:
    """Return the electrons of the unblurred picture, and of stars outside of it."""
    return total_electrons(s) + off_plane_star_electrons(s)


@cached_per_situation
def _peak_light_electrons(s: Situation) -> float:
    """Bound any pixel's electrons of blurred light, by Young, the PSF's peak, or frequency."""
    sharpest = float(s.picture_probe.brightest) * max_light_seconds(s)
    if not has_known_psf(s):
        return sharpest
    beside = off_plane_star_electrons(s)
    sharpest = min(sharpest, zeroth_order_share(s) * sharpest + beside)
    in_phase = s.picture_probe.power_spectrum.filtered_peak_bound(lambda k: mtf_bound(s, k))
    summed = peak_pixel_share(s) * all_electrons(s)
    return min(sharpest, summed, in_phase * max_light_seconds(s) + beside)


def finest_octave_norm(s: Situation) -> float:
    """Bound the norm of light in the octave that pixels resolve and fold back, electrons/s."""
    pitch = s.camera.sensor.pitch
    return s.picture_probe.power_spectrum.filtered_norm_bound(
        lambda k: (k * pitch >= 0.25).astype(np.float64)
    )


def relative_light_change(s: Situation, change: float) -> float:
    """Return a change of the light, an L2 norm in electrons, over all of it."""
    whole = light_norm_bound(s)
    return change / whole if whole else 0.0


@cached_per_situation
def light_norm_bound(s: Situation) -> float:
    """Bound the L2 norm of the blurred picture's electrons, by Young, its sum, or frequency."""
    if not has_known_psf(s):
        return sharp_norm_bound(s)
    summed = math.sqrt(psf_energy_bound(s)) * all_electrons(s)
    resolved = s.picture_probe.power_spectrum.filtered_norm_bound(lambda k: mtf_bound(s, k))
    resolved = resolved * max_light_seconds(s) + off_plane_star_electrons(s)
    return min(sharp_norm_bound(s), summed, resolved)


def dark_current_electrons(s: Situation) -> float:
    """Return the dark-current electrons of a pixel that isn't hot."""
    return s.camera.sensor.dark_current * s.exposure


def hot_pixel_norm(s: Situation) -> float:
    """Bound the L2 norm of the hot pixels' electrons."""
    sensor = s.camera.sensor
    count = affected_pixel_bound(sensor.hot, pixel_count(s))
    return sensor.hot_current * s.exposure * math.sqrt(count)


def affected_pixel_bound(share: float, count: int) -> float:
    """Bound how many pixels are hit, each with probability `share`: 5 σ above the mean."""
    expected = share * count
    return min(float(count), expected + 5 * math.sqrt(expected)) if share else 0.0


def peak_electrons(s: Situation) -> float:
    """Bound the brightest pixel's electrons, hot pixels included."""
    sensor, variance = s.camera.sensor, speckle_variance(s)
    # Of speckle five standard deviations, and as many means of an exponential distribution as all
    # but one in 10,000 pixels stay below.
    speckled = 1 + 5 * math.sqrt(variance) + 4 * variance
    lit = _peak_light_electrons(s) * (1 + MAX_PIXEL_SIGMAS * sensor.prnu) * speckled
    hot = sensor.hot_current * s.exposure if sensor.hot else 0.0
    return lit + dark_current_electrons(s) + hot


def electron_norm_bound(s: Situation) -> float:
    """Bound the L2 norm of all pixels' electrons, of light, dark current and hot pixels."""
    gain = 1 + MAX_PIXEL_SIGMAS * s.camera.sensor.prnu
    dark = dark_current_electrons(s) * sqrt_pixel_count(s)
    return light_norm_bound(s) * gain + dark + hot_pixel_norm(s)


def shot_noise_norm(s: Situation) -> float:
    """Bound the L2 norm of the frame's shot noise by that of its electrons (Cauchy-Schwarz)."""
    return math.sqrt(electron_norm_bound(s) * sqrt_pixel_count(s))


def clipping_onset(sensor: Sensor) -> float:
    """Return the electrons from which full well or converter clip, shot noise not counted."""
    spread = 7 * sensor.read_noise + MAX_PIXEL_SIGMAS * sensor.dsnu
    top = (sensor.top_number - sensor.black_level) * sensor.gain
    return max(min(sensor.full_well, top - spread), 0.0)


def can_clip(s: Situation) -> bool:
    """Whether any pixel can come within 7 σ of clipping, by the brightest pixel's shot noise."""
    most = peak_electrons(s)
    return most + 7 * math.sqrt(most) + 20 > clipping_onset(s.camera.sensor)


def without_clipping(s: Situation, recipe: Recipe) -> Recipe:
    """Return the recipe with unlimited full wells and converter, if any pixel may clip.

    Errors are counted before a full well clips them (see simulator.effects.picture_norms).
    """
    return recipe.with_changes(clipping=False) if can_clip(s) else recipe


def unclipped_light(s: Situation) -> float:
    """Return the electrons of light up to which nothing clips, with 7 σ of shot noise."""
    free = max(clipping_onset(s.camera.sensor) - 20 - dark_current_electrons(s), 0.0)
    # Solves x + 7 √x = free for x.
    root = max(math.sqrt(free + 12.25) - 3.5, 0.0)
    return root**2 / (1 + MAX_PIXEL_SIGMAS * s.camera.sensor.prnu)


@cached_per_situation
def full_well_count(s: Situation) -> float:
    """Bound the number of pixels that hold more light than surely doesn't clip.

    A blurred picture m has no more of (m - θ)₊, and of its square, than the sharp picture, for any
    θ (Jensen: a blur is a mean). Where m is above W > θ, m is at most W / (W - θ) times m - θ.
    """
    if not can_clip(s):
        return 0.0
    count, well = float(pixel_count(s)), unclipped_light(s)
    if well <= 0:
        return count
    total, energy = all_electrons(s), light_norm_bound(s) ** 2
    if not s.picture_probe.off_plane_star_rate:
        for share in (0.5, 0.7, 0.8, 0.9):
            over = s.picture_probe.excess_over(share * well / max_light_seconds(s))
            # Orders of the panel or an uneven lamp may raise a pixel's light by a tenth (audited).
            factor = 1.1 * max_light_seconds(s) / (1 - share)
            total = min(total, factor * over[0])
            energy = min(energy, factor**2 * over[1])
    sensor = s.camera.sensor
    hot = affected_pixel_bound(sensor.hot, pixel_count(s)) if sensor.hot_current else 0.0
    return min(count, energy / well**2 + hot, total / well + hot)


def can_clip_at_zero(sensor: Sensor) -> bool:
    """Whether noise and offset of a dark pixel can reach the converter's lower end."""
    room = sensor.black_level * sensor.gain - MAX_PIXEL_SIGMAS * sensor.dsnu
    return room < 8 * sensor.read_noise + sensor.gain


def sensor_error_bound(s: Situation, change: float, how: str, *, read_noise: bool = True) -> Bound:
    """Bound the error of mean, variance and σ when the picture's electrons change.

    Mean and variance change by the change times their steepest slope, at any number of electrons up
    to the brightest pixel's, with read noise. Electrons above a full well count as if they weren't
    clipped (see minimum_norms()).

    For σ, |√a - √b| is |a - b| over √a + √b. Both roots are at least those of read noise and of the
    light in the dim tenth of the picture (audited: a change is no larger in the dark). |√a - √b| is
    also at most √|a - b|, whose squares add up to at most √pixels times the change
    (Cauchy-Schwarz).

    change: L2 norm of the change of the picture's electrons over the exposure.
    read_noise: whether read noise may be relied on; without it, a few electrons change σ much.
    """
    sensor = s.camera.sensor
    if s.cache.are_estimates:  # as if nothing was clipped or rounded
        mean, variance, least = 1.0, 1.0, sensor.read_noise
    else:
        most = _next_power_of_two(peak_electrons(s))
        unclipped = min(most, float(round(unclipped_light(s))))
        mean, variance, least = _steepest_slopes(sensor, most, unclipped)
    varied = variance * change
    sigma = math.sqrt(varied * sqrt_pixel_count(s))
    if read_noise and least:
        # The blur may halve the electrons in the dim tenth of the sharp picture.
        dim = 0.5 * s.picture_probe.dim_decile * s.exposure
        sigma = min(sigma, varied / (2 * math.hypot(least, math.sqrt(dim))))
    return Bound(mean * change, varied, sigma, how=how)


def sigma_by_light(bound: Bound, change: float, electrons: float) -> float:
    """Bound σ's change, as |√a - √b|² ≤ |a - b|, by norm and sum of those of the electrons."""
    slope = bound.variance / change if change else 0.0
    return math.sqrt(slope * electrons)


def proportional_error_bound(
    s: Situation, change: float, how: str, dim_pixel_margin: float = _DIM_PIXEL_MARGIN
) -> Bound:
    """Bound the frame's error when each pixel's light changes in proportion.

    The bound is sensor_error_bound() with a tighter σ. A dim pixel's relative change is at most
    `dim_pixel_margin` times that of the whole picture.
    Where m changes by a share ε of it, √(m + r²) changes by at most ε √m / 2, for any read noise r:
    over all pixels, by ε/2 times the square root of the sum of all light.
    """
    bound = sensor_error_bound(s, change, how)
    norm = light_norm_bound(s)
    if not norm:
        return bound
    root = sigma_by_light(bound, change, all_electrons(s))
    return replace(bound, sigma=min(bound.sigma, dim_pixel_margin * change / norm / 2 * root))


def _next_power_of_two(electrons: float) -> float:
    """Round a number of electrons up to a power of two, at least 64."""
    return 2.0 ** math.ceil(math.log2(max(electrons, 64.0)))


@functools.lru_cache(maxsize=64)
def _steepest_slopes(
    sensor: Sensor, most: float, unclipped_electrons: float
) -> tuple[float, float, float]:
    """Return the steepest slopes of mean and variance by electrons, and the least σ.

    The slopes are the largest at any number of electrons up to `most`; σ includes read noise.
    unclipped_electrons: number up to which the upper end clips nothing. Without clipping, the
        converter's steps of g electrons make the slopes oscillate by exp(-2 π² m / g²) at m
        electrons (Widrow): this is negligible from g² electrons on.
    """
    slopes, least = [], math.inf
    rounded = min(most, _next_power_of_two(sensor.gain**2))
    for clipping, quantisation in itertools.product((True, False), repeat=2):
        end = unclipped_electrons if clipping else rounded
        for table in moment_tables(
            sensor, Stages(clipping=clipping, quantisation=quantisation), end
        ):
            slopes.append(table.max_slopes(end))
            least = min(least, table.min_variance(end))
    mean, variance = np.array(slopes).max(axis=0)
    # A normal distribution in place of Poisson's may be steeper by a hundredth (audited).
    steepest = [1.01 * max(float(one), 1.0) for one in (mean, variance)]
    return steepest[0], steepest[1], math.sqrt(least) if sensor.read_noise else 0.0
