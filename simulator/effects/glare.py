"""Light that the lens reflects where it doesn't belong: veiling glare, and ghosts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy.special
from numpy.typing import NDArray

from optics.camera.ghost import total_share
from simulator.effects.electron_bounds import (
    PixelwiseEffect,
    all_electrons,
    ghost_gain,
    light_norm_bound,
    max_light_seconds,
    pixel_count,
    sensor_error_bound,
    sigma_by_light,
    sqrt_pixel_count,
)
from simulator.effects.light_effects import FAR, LightChange
from simulator.effects.psf_bounds import is_uniform_scene, mtf_bound
from simulator.effects.rendering_work import (
    LENS_GHOSTS,
    added_operations,
    channel_count_at,
    picture_samples_at,
)
from simulator.effects.result_cache import cached_across_patterns, cached_per_situation
from simulator.effects.vignetting_bounds import max_vignetting_change, unevenness
from simulator.formation.ghosts import ghost_operations
from simulator.planning import Bound
from simulator.probing.picture_probe import MARGIN, PictureProbe
from simulator.situation import Situation

Array = NDArray[np.float64]


class VeilingGlare(PixelwiseEffect):
    name = "veiling glare"
    recipe_field = "glare"
    operations_per_pixel = 3.0
    physics = "some of the light is reflected to and fro, and veils the picture evenly"
    source = "ISO 9358:1994, veiling glare index of image-forming systems"

    def is_present(self, s: Situation) -> bool:
        return s.camera.glare > 0 and not s.picture_probe.is_dark

    def estimated_error_if_omitted(self, s: Situation) -> float:
        """Estimate the glare times the sharp picture's relative difference from its mean."""
        if not s.picture_probe.norm_bound:
            return 0.0
        even = s.picture_probe.total**2 / pixel_count(s) / s.picture_probe.norm_bound**2
        return s.camera.glare * unevenness(s) * math.sqrt(max(1 - even, 0.0))

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        """Bound the frame's error by the glare times the picture's difference from its mean.

        A picture differs from its mean by no more than its own norm. Glare gives dark pixels much
        of their light, so that the light of the dim tenth of the picture limits the change of σ in
        the other nine tenths only. In the dim tenth, σ² changes by no more than the variance (|√a -
        √b|² ≤ |a - b|).
        """
        glare = s.camera.glare * unevenness(s)
        how = "proved: the picture against its mean; Cauchy-Schwarz"
        change = glare * light_norm_bound(s)
        bound = sensor_error_bound(s, change, how)
        moved = bound.variance / change * glare * all_electrons(s) if bound.variance else 0.0
        sigma = min(math.hypot(bound.sigma, math.sqrt(0.1 * moved)), math.sqrt(2 * moved))
        return replace(bound, sigma=sigma)

    def explain(self, s: Situation) -> str:
        return f"{s.camera.glare:.2g} of the light is spread evenly over the sensor"


class LensGhosts(LightChange):
    name = LENS_GHOSTS
    recipe_field = "ghosts"
    noise_change = FAR
    physics = "two of the lens' surfaces reflect some light, which makes a copy out of focus"
    source = "Hullin et al. 2011, doi 10.1145/2010324.1965003; Lee and Eisemann 2013, ray matrices"
    how = "proved: no more than all ghosts, and all light that they take from the picture"

    def is_caused(self, s: Situation) -> bool:
        return total_share(s.camera.ghosts) > 0

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        """Bound the ghosts and the light that they take; dark pixels count as for veiling glare."""
        change = self.change(s)
        bound = sensor_error_bound(s, change, self.how, read_noise=False)
        taken = total_share(s.camera.ghosts) * all_electrons(s)
        moved = taken + sum(one.total for one in _ghost_lights(s))
        return replace(bound, sigma=min(bound.sigma, sigma_by_light(bound, change, moved)))

    def added_operations(self, s: Situation, levels: Mapping[str, int]) -> float:
        if not levels[self.name]:
            return 0.0
        ghosts = len(s.camera.ghosts) * channel_count_at(s, levels)
        pictures = max(1, len(s.panel_content.pictures))
        own = ghosts * pictures * ghost_operations(picture_samples_at(s, levels))
        return own + added_operations(s, levels, self.name)

    def explain(self, s: Situation) -> str:
        ghosts = s.camera.ghosts
        brightest = max(ghosts, key=lambda one: one.brightness)
        size = f"{brightest.magnification:.2g} times as large as the picture"
        share = f"{total_share(ghosts):.2g} of the light is in {len(ghosts)} of them"
        return f"{share}; the brightest is {size}"

    def change(self, s: Situation) -> float:
        """Bound the L2 norm of the electrons that ghosts add and take.

        Both are positive: the square of their difference is no more than the sum of their squares.
        """
        light = light_norm_bound(s) / ghost_gain(s.camera)
        taken = total_share(s.camera.ghosts) * light
        added = sum(one.norm for one in _ghost_lights(s))
        most = math.hypot(taken, added)
        if not is_uniform_scene(s):
            return most
        # Even light and its ghosts differ by a factor, but for what vignetting makes of both.
        kept = sum(one.brightness - one.share for one in s.camera.ghosts)
        uneven = max_vignetting_change(s) * (taken + added)
        return min(abs(kept) * light + uneven, most)


class _GhostLight(NamedTuple):
    """Bounds of a ghost's electrons in the frame, its share included: their L2 norm and sum."""

    norm: float
    total: float


@cached_per_situation
def _ghost_lights(s: Situation) -> list[_GhostLight]:
    """Bound the light in each ghost by the picture that larger or smaller pixels see.

    Three bounds of the norm are compared: by frequency, for a disc takes the detail (Parseval); by
    the brightest pixel; and by the light of all points, each spread over its disc (Young).
    """
    found, count, pitch = [], sqrt_pixel_count(s), s.camera.sensor.pitch
    for ghost in s.camera.ghosts:
        # Cells of more pixels for a wide disc, so that the probe's margin holds all light that the
        # disc brings into the frame.
        cells = max(1, math.ceil(ghost.blur_diameter / 2 / (MARGIN * pitch)))
        probe = _ghosts_probe(s, abs(ghost.magnification), cells)
        total = probe.total_with_margin + probe.off_plane_star_rate
        disc = math.pi * ghost.blur_diameter**2 / 4 / pitch**2
        brightest = probe.brightest / cells**2

        def passed(
            k: Array, width: float = ghost.blur_diameter / abs(ghost.magnification)
        ) -> Array:
            return disc_gain_bound(k * width) * mtf_bound(s, k)

        by_frequency = probe.power_spectrum.filtered_norm_bound(passed) / cells
        norms = [by_frequency + probe.off_plane_star_rate, count * brightest]
        if disc:
            norms += [total / math.sqrt(disc), count * total / disc]
        seconds = ghost.share * max_light_seconds(s) / ghost_gain(s.camera)
        most = min(total, count**2 * brightest)
        found.append(_GhostLight(seconds * min(norms), seconds * most))
    return found


def disc_gain_bound(k: Array) -> Array:
    """Bound the modulus of a disc's transfer function by one that only falls.

    2 J1(x) / x falls from 1 at 0, and from 2.5 on is no more than 1.03 √(8/π) x^-3/2, for J1² + Y1²
    is no more than 1.03² 2/(π x) there.
    k: cycles in the disc's diameter.
    """
    x = np.maximum(np.pi * k, 1e-9)
    envelope = 1.03 * math.sqrt(8 / math.pi) * np.maximum(x, 1.0) ** -1.5
    return np.asarray(np.where(x < 2.5, 2 * scipy.special.j1(x) / x, envelope))


@cached_across_patterns
def _ghosts_probe(s: Situation, magnification: float, cells: int) -> PictureProbe:
    """Return a probe of what a ghost shows, on cells of pixels as much larger as it is smaller."""
    probe = s.picture_probe
    sensor = probe.camera.sensor
    rows, columns = (math.ceil(n / cells) for n in sensor.shape)
    # Data of the sensor and lens that don't fit another frame don't count here.
    lens = replace(probe.camera.lens, relative_illumination=(), distortion=(0.0, 0.0))
    seen = replace(sensor, shape=(rows, columns), pitch=sensor.pitch * cells / magnification)
    camera = replace(probe.camera, sensor=seen, lens=lens, ghosts=())
    return PictureProbe(probe.target, camera, probe.band, probe.shift)
