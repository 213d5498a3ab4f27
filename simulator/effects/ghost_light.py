"""Bounds of the light in a lens' ghosts, for the effect that adds them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy.special
from numpy.typing import NDArray

from optics.camera import Ghost
from simulator.effects.electron_bounds import ghost_gain, max_light_seconds
from simulator.effects.psf_bounds import mtf_bound
from simulator.effects.result_cache import cached_across_patterns
from simulator.probing.picture_probe import MARGIN, PictureProbe
from simulator.situation import Situation

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GhostLight:
    """Bounds of a ghost's electrons in the frame, its share included, for the lens ghosts effect.

    norm: L2 norm over the pixels. total: sum.
    """

    norm: float
    total: float


def ghost_lights(s: Situation) -> tuple[GhostLight, ...]:
    """Return bounds of the light in each ghost, for the lens ghosts effect."""
    return tuple(_ghost_light(s, one) for one in s.camera.ghosts)


def _ghost_light(s: Situation, ghost: Ghost) -> GhostLight:
    """Bound the light in a ghost by the picture that larger or smaller pixels see (lens ghosts).

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
    """Bound the modulus of a disc's transfer function by one that only falls, for lens ghosts.

    k: cycles in the disc's diameter. 2 J1(x) / x falls from 1 at 0, and from 2.5 on is no more
    than 1.03 √(8/π) x^-3/2, for J1² + Y1² is no more than 1.03² 2/(π x) there.
    """
    x = np.maximum(np.pi * k, 1e-9)
    envelope = 1.03 * math.sqrt(8 / math.pi) * np.maximum(x, 1.0) ** -1.5
    return np.asarray(np.where(x < 2.5, 2 * scipy.special.j1(x) / x, envelope))


def _cells(s: Situation, ghost: Ghost) -> int:
    """Return the pixels along a cell on which a lens ghost is probed: more for a wide disc.

    The probe's margin then holds all light that the disc brings into the frame.
    """
    return max(1, math.ceil(ghost.blur_diameter / 2 / (MARGIN * s.camera.sensor.pitch)))


def _ghosts_probe(s: Situation, ghost: Ghost, cells: int) -> PictureProbe:
    """Return a probe of what a lens ghost shows, on pixels as much larger as it is smaller."""
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
