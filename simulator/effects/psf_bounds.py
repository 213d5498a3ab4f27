"""How little a blurred picture's light may be spread, and how far it may go: what many bounds
need to know of the PSF, whichever effects are on.

Waves are what is meant: that the rays of the same wavefront are told apart counts on its own.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from optics.plane import Plane
from optics.pupil import open_area
from optics.stop_shadow import share_through_stop
from optics.validation import as_number
from simulator.effects.result_cache import cached_per_situation
from simulator.formation.vignetting import vignetting
from simulator.formation.windows import max_blur_distance
from simulator.scene.drawable import UniformLight
from simulator.situation import Situation

Array = NDArray[np.float64]

_MARGIN = 1.3
"""Audited: a pattern may be brighter at another wavelength of the band, or with some of the
panel's effects and not others, than with all or with none."""

_FADING = 4.0
"""Sensor pixels over which the middle order fades into the next."""

_OCTAVE = 1.1
"""Frequencies that are looked at around one, for the same reason."""


def has_known_psf(s: Situation) -> bool:
    """Whether all light has PSFs that are like those which are looked at: of one distance."""
    return len(set(s.picture_probe.distances)) == 1 and not has_occlusion(s)


def has_occlusion(s: Situation) -> bool:
    """Whether anything stands before something else."""
    return any(layer.cover is not None for layer in s.target.layers)


@cached_per_situation
def peak_pixel_share(s: Situation) -> float:
    """Share of a point's light on a pixel, at most. 1 where the PSF isn't known."""
    if not has_known_psf(s):
        return 1.0
    return _on_pixel(s, s.pattern_probe.peak)


@cached_per_situation
def psf_energy_bound(s: Situation, beyond: float = 0.0) -> float:
    """Sum over pixels of the squared shares of a point's light that they get, at most; of what
    falls beyond a square of so many metres to each side, if that is given."""
    if not has_known_psf(s):
        return 1.0
    return _on_pixel(
        s,
        s.pattern_probe.squared_density_beyond(beyond)
        if beyond
        else s.pattern_probe.squared_density,
    )


def _on_pixel(s: Situation, density: float) -> float:
    """Of a pixel's area, for a density in the middle of band and field, 1/m²."""
    density *= _brighter(s)
    if s.camera.separation:
        # Other places light other parts of the panel: amplitudes add.
        lit = open_area(s.camera) / (s.wavelength * as_number(s.camera.ray_matrix_b)) ** 2
        density = (math.sqrt(density) + illuminated_area_change(s) * math.sqrt(lit)) ** 2
    return min(density * s.camera.sensor.pitch**2, 1.0)


def zeroth_order_share(s: Situation) -> float:
    """Share of a point's light that doesn't leave for orders which never come near, at most."""
    if can_orders_reach_sensor(s) or is_uniform_scene(s):
        return 1.0
    return min(1.05 * s.pattern_probe.zeroth_order_share, 1.0)


def can_orders_reach_sensor(s: Situation) -> bool:
    """Whether any pixel lies half a period from any light's image, where the first one begins."""
    shortest = min(s.band.support[0], s.band.leak_range[0] if s.band.leak else math.inf)
    period = s.pattern_probe.period * shortest / s.wavelength
    return max(max_blur_distance(s)) + _FADING * s.camera.sensor.pitch > period / 2


def _brighter(s: Situation) -> float:
    """Than at the middle of the band, at its short end."""
    return _MARGIN * s.band.centre**2 / s.band.support[0] ** 2


def mtf_bound(s: Situation, frequency: Array) -> Array:
    """|H| at most, of any PSF that may be, at cycles per metre on the sensor."""
    if not has_known_psf(s):
        return np.ones_like(frequency)
    spread = _OCTAVE * s.band.support[1] / s.band.support[0]
    most = _MARGIN * s.pattern_probe.transfer_bounds.modulus_bound(frequency.ravel(), spread)
    if s.camera.separation:
        differs = illuminated_area_change(s)
        most = most + 2 * math.sqrt(differs) + differs
    return np.minimum(most, 1.0).reshape(frequency.shape)


def illuminated_area_change(s: Situation) -> float:
    """Area of the panel that is lit from the axis or from a corner, and not from both, over what
    is lit from the axis: a shadow that moves by v changes v times its width on either side."""
    sensor, lens = s.camera.sensor, s.camera.lens
    corner = math.hypot(*(n * sensor.pitch / 2 for n in sensor.shape))
    moved = as_number(s.camera.separation) * corner / lens.image_distance
    distance = min(s.picture_probe.distances)
    lit = open_area(s.camera) * share_through_stop(s.camera, distance, (0.0, 0.0))
    width = min(as_number(lens.stop_diameter), max(s.camera.panel.shape) * s.camera.panel.pitch)
    return min(2 * moved * 2 * width / lit, 2.0) if lit else 2.0


@cached_per_situation
def max_vignetting_change(s: Situation) -> float:
    """Share of a point's light that is lost or gained off the axis, on a few places of the frame
    and its margin, corners among them."""
    distances = {min(s.picture_probe.distances), max(s.picture_probe.distances)}
    return float((vignetting_samples(s, s.picture_probe.plane.shape, distances) - 1).abs().max())


def vignetting_samples(
    s: Situation, shape: Sequence[int], distances: Collection[float]
) -> torch.Tensor:
    """Share of the light that each distance's places keep: 9 x 9 of them over so many pixels,
    from corner to corner."""
    camera = s.camera
    if not s.mount.is_aligned:
        camera = replace(camera, lens=s.mount.lens_in_panel_axes(camera.lens))
    rows, columns = (n * camera.sensor.pitch / 8 for n in shape)
    plane = Plane((9, 9), (rows, columns))
    return torch.stack([vignetting(camera, s.mount, plane, d) for d in distances])


def is_uniform_scene(s: Situation) -> bool:
    """Whether all light is endless and even, and nothing stands before it."""
    parts = [part.picture for layer in s.target.layers for part in layer.parts]
    return (
        bool(parts) and all(isinstance(one, UniformLight) for one in parts) and not has_occlusion(s)
    )


def blur_sensitivity(s: Situation) -> float:
    """How much of the light a change of the PSF can change at all: endless even light stays so,
    but for what vignetting makes of it."""
    return min(max_vignetting_change(s), 1.0) if is_uniform_scene(s) else 1.0
