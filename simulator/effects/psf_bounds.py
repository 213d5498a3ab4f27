"""Bounds of a PSF's spread and reach that hold whatever else is on.

They hold for waves; the error of replacing waves by rays is counted separately.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from optics.camera.pupil import open_area, share_through_stop
from optics.validation import as_number
from simulator.effects.field_waves import psf_change, wave_distance
from simulator.effects.result_cache import cached_per_situation
from simulator.formation.windows import ORDER_FADE_PIXELS, max_blur_distance
from simulator.scene.drawable import UniformLight
from simulator.situation import Situation

Array = NDArray[np.float64]


_MARGIN, _FREQUENCY_FACTOR = 1.3, 1.1
"""Factor by which a PSF may be brighter, from audits, at another wavelength of the band, or with
some of the panel's imperfections, than with all of them or with none; and factor by which
frequencies around one are searched for the largest modulus, for the same reason."""


def has_known_psf(s: Situation) -> bool:
    """Whether bounds may use the probed PSF: one distance, and no layer hides another."""
    return len(set(s.picture_probe.distances)) == 1 and not has_occlusion(s)


def has_occlusion(s: Situation) -> bool:
    """Whether any layer of the target hides another."""
    return any(layer.cover is not None for layer in s.target.layers)


@cached_per_situation
def peak_pixel_share(s: Situation) -> float:
    """Bound the share of a point's light on any one pixel; 1 for an unknown PSF."""
    return _on_pixel(s, s.pattern_probe.peak) if has_known_psf(s) else 1.0


@cached_per_situation
def psf_energy_bound(s: Situation, beyond: float = 0.0) -> float:
    """Bound the sum of a PSF's squared shares of pixels, or that `beyond` metres to each side."""
    if not has_known_psf(s):
        return 1.0
    probe = s.pattern_probe
    return _on_pixel(s, probe.squared_density_beyond(beyond) if beyond else probe.squared_density)


def _on_pixel(s: Situation, density: float) -> float:
    """Bound a PSF's share on one pixel by its density in the middle of band and field, 1/m²."""
    # It is denser at the band's short end than at its centre.
    density *= _MARGIN * s.band.centre**2 / s.band.support[0] ** 2
    # Off the axis, light passes another part of the panel, and is aberrated more: amplitudes add.
    apart = illuminated_area_change(s) if s.camera.separation else 0.0
    apart += wave_distance(s)
    if apart:
        density = (math.sqrt(density) + apart * math.sqrt(full_aperture_density(s))) ** 2
    return min(density * s.camera.sensor.pitch**2, 1.0)


def full_aperture_density(s: Situation) -> float:
    """Return the densest that a PSF can be, all amplitudes in phase, in shares per m²."""
    camera = s.mount.camera_in_panel_axes(s.camera)
    return open_area(camera) / (s.wavelength * as_number(s.camera.ray_matrix_b)) ** 2


def zeroth_order_share(s: Situation) -> float:
    """Bound the share of a point's light that diffraction orders leave on the sensor."""
    if can_orders_reach_sensor(s) or is_uniform_scene(s):
        return 1.0
    return min(1.05 * s.pattern_probe.zeroth_order_share, 1.0)


def can_orders_reach_sensor(s: Situation) -> bool:
    """Whether side orders, which begin half a period from an image, can reach a pixel."""
    period = s.pattern_probe.period * s.band.whole_support[0] / s.wavelength
    return max(max_blur_distance(s)) + ORDER_FADE_PIXELS * s.camera.sensor.pitch > period / 2


def mtf_bound(s: Situation, frequency: Array) -> Array:
    """Bound the MTF ``|H|`` of any PSF, at cycles per metre on the sensor."""
    if not has_known_psf(s):
        return np.ones_like(frequency)
    spread = _FREQUENCY_FACTOR * s.band.support[1] / s.band.support[0]
    transfer = s.pattern_probe.transfer_bounds
    most = _MARGIN * transfer.modulus_bound(frequency.ravel(), spread)
    if s.camera.separation:
        differs = illuminated_area_change(s)
        most = most + 2 * math.sqrt(differs) + differs
    most = most + psf_change(s)
    return np.minimum(most, 1.0).reshape(frequency.shape)


def illuminated_area_change(s: Situation) -> float:
    """Return the panel area lit from only one of axis and corner, over that lit from the axis.

    A shadow that moves by v changes v times its width on either side.
    """
    sensor, lens = s.camera.sensor, s.camera.lens
    corner = math.hypot(*(n * sensor.pitch / 2 for n in sensor.shape))
    moved = as_number(s.camera.separation) * corner / lens.image_distance
    distance = min(s.picture_probe.distances)
    camera = s.mount.camera_in_panel_axes(s.camera)
    axis = s.mount.place_in_panel_axes((0.0, 0.0), camera, distance)
    lit = open_area(camera) * share_through_stop(camera, distance, axis)
    width = min(as_number(lens.stop_diameter), max(s.camera.panel.shape) * s.camera.panel.pitch)
    return min(2 * moved * 2 * width / lit, 2.0) if lit else 2.0


def is_uniform_scene(s: Situation) -> bool:
    """Whether blur changes nothing: all light is uniform and endless, and nothing is hidden."""
    parts = [part.picture for layer in s.target.layers for part in layer.parts]
    even = bool(parts) and all(isinstance(one, UniformLight) for one in parts)
    return even and not has_occlusion(s)
