"""A lens' ghosts: copies of the picture, scaled and out of focus."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy.special
from numpy.typing import NDArray

from optics.camera import Ghost
from optics.camera.ghost import total_share
from simulator.effects.electron_bounds import (
    ghost_gain,
    light_norm_bound,
    max_light_seconds,
    off_plane_star_electrons,
    relative_light_change,
    sensor_error_bound,
    total_electrons,
)
from simulator.effects.likely_errors import FAR, LightEffect
from simulator.effects.psf_bounds import is_uniform_scene, mtf_bound
from simulator.effects.rendering_work import (
    LENS_GHOSTS,
    added_operations,
    channel_count_at,
    picture_samples_at,
)
from simulator.effects.result_cache import cached_across_patterns
from simulator.effects.vignetting_bounds import max_vignetting_change
from simulator.formation.ghosts import ghost_operations
from simulator.planning import Bound, OnOffEffect
from simulator.probing.picture_probe import MARGIN, PictureProbe
from simulator.situation import Situation

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GhostLight:
    """Bounds of a ghost's electrons in the frame, its share included.

    norm: L2 norm over the pixels.
    total: sum.
    """

    norm: float
    total: float


def ghost_lights(s: Situation) -> tuple[GhostLight, ...]:
    return tuple(_ghost_light(s, one) for one in s.camera.ghosts)


def _ghost_light(s: Situation, ghost: Ghost) -> GhostLight:
    """Bound the light in a ghost by the picture that larger or smaller pixels see.

    Three bounds of the norm are compared: by frequency, for a disc takes the detail (Parseval); by
    the brightest pixel; and by the light of all points, each spread over its disc (Young).
    """
    cells = _cells(s, ghost)
    probe = _ghosts_probe(s, ghost, cells)
    width = ghost.blur_diameter / abs(ghost.magnification)

    def passed(k: Array) -> Array:
        return disc_gain_bound(k * width) * mtf_bound(s, k)

    count = math.sqrt(math.prod(s.camera.sensor.shape))
    total = probe.total_with_margin + probe.off_plane_star_rate
    disc = math.pi * ghost.blur_diameter**2 / 4 / s.camera.sensor.pitch**2
    brightest = probe.brightest / cells**2
    by_frequency = probe.power_spectrum.filtered_norm_bound(passed) / cells
    norms = [by_frequency + probe.off_plane_star_rate, count * brightest]
    if disc:
        norms += [total / math.sqrt(disc), count * total / disc]
    seconds = ghost.share * max_light_seconds(s) / ghost_gain(s.camera)
    return GhostLight(seconds * min(norms), seconds * min(total, count**2 * brightest))


def disc_gain_bound(k: Array) -> Array:
    """Bound the modulus of a disc's transfer function by one that only falls.

    2 J1(x) / x falls from 1 at 0, and from 2.5 on is no more than 1.03 √(8/π) x^-3/2, for J1² + Y1²
    is no more than 1.03² 2/(π x) there.
    k: cycles in the disc's diameter.
    """
    x = np.maximum(np.pi * k, 1e-9)
    envelope = 1.03 * math.sqrt(8 / math.pi) * np.maximum(x, 1.0) ** -1.5
    return np.asarray(np.where(x < 2.5, 2 * scipy.special.j1(x) / x, envelope))


def _cells(s: Situation, ghost: Ghost) -> int:
    """Return the pixels along a cell on which a ghost is probed: more for a wide disc.

    The probe's margin then holds all light that the disc brings into the frame.
    """
    return max(1, math.ceil(ghost.blur_diameter / 2 / (MARGIN * s.camera.sensor.pitch)))


def _ghosts_probe(s: Situation, ghost: Ghost, cells: int) -> PictureProbe:
    """Return a probe of what a ghost shows, on pixels as much larger as it is smaller."""
    probe = s.picture_probe
    sensor = probe.camera.sensor
    rows, columns = (math.ceil(n / cells) for n in sensor.shape)
    pitch = sensor.pitch * cells / abs(ghost.magnification)

    def make() -> PictureProbe:
        # Data of the sensor and lens that don't fit another frame don't count here.
        lens = replace(probe.camera.lens, relative_illumination=(), distortion=(0.0, 0.0))
        seen = replace(sensor, shape=(rows, columns), pitch=pitch)
        camera = replace(probe.camera, sensor=seen, lens=lens, ghosts=())
        return PictureProbe(probe.target, camera, probe.band, probe.shift)

    causes = ("ghost", abs(ghost.magnification), cells, sensor.shape, sensor.pitch)
    return cached_across_patterns(s, causes, make)


class LensGhosts(OnOffEffect, LightEffect):
    name = LENS_GHOSTS
    recipe_field = "ghosts"
    noise_change = FAR
    physics = "two of the lens' surfaces reflect some light, which makes a copy out of focus"
    source = "Hullin et al. 2011, doi 10.1145/2010324.1965003; Lee and Eisemann 2013, ray matrices"

    def is_present(self, s: Situation) -> bool:
        return total_share(s.camera.ghosts) > 0 and not s.picture_probe.is_dark

    def estimated_error_if_omitted(self, s: Situation) -> float:
        return relative_light_change(s, _change(s, ghost_lights(s)))

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        """Bound the frame's error by the ghosts, and by the light that they take from the picture.

        Both are positive, so that the square of their difference is no more than the sum of their
        squares. Dark pixels beside bright ones count as they do for veiling glare: |√a - √b|² ≤ |a
        - b|.
        """
        ghosts = ghost_lights(s)
        how = "proved: no more than all ghosts, and all light that they take from the picture"
        change = _change(s, ghosts)
        bound = sensor_error_bound(s, change, how, read_noise=False)
        slope = bound.variance / change if change else 0.0
        taken = total_share(s.camera.ghosts) * (total_electrons(s) + off_plane_star_electrons(s))
        moved = taken + sum(one.total for one in ghosts)
        sigma = min(bound.sigma, math.sqrt(slope * moved))
        return Bound(bound.mean, bound.variance, sigma, how=how)

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
        return (
            f"{total_share(ghosts):.2g} of the light is in {len(ghosts)} of them; the brightest is "
            f"{brightest.magnification:.2g} times as large as the picture"
        )


def _change(s: Situation, ghosts: tuple[GhostLight, ...]) -> float:
    """Bound the L2 norm of the electrons that ghosts add and take."""
    light = light_norm_bound(s) / ghost_gain(s.camera)
    taken = total_share(s.camera.ghosts) * light
    added = sum(one.norm for one in ghosts)
    most = math.hypot(taken, added)
    if not is_uniform_scene(s):
        return most
    # Even light and its ghosts differ by a factor, but for what vignetting makes of both.
    kept = sum(one.brightness - one.share for one in s.camera.ghosts)
    uneven = max_vignetting_change(s) * (taken + added)
    return min(abs(kept) * light + uneven, most)
