"""Bounds of a PSF's spread and reach that hold whichever effects are on.

They hold for waves; the error of replacing waves by rays is counted separately.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from optics.camera import Camera
from optics.plane import Plane
from optics.pupil import open_area
from optics.stop_shadow import share_through_stop
from optics.validation import as_number
from simulator.effects.result_cache import cached_per_situation
from simulator.effects.spectra import angle_shares
from simulator.formation.vignetting import vignetting
from simulator.formation.windows import ORDER_FADE_PIXELS, max_blur_distance
from simulator.scene.drawable import UniformLight
from simulator.situation import Situation

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PSFBoundSettings:
    """Tune the bounds of PSFs that hold whichever effects are on.

    Attributes
    ----------
    margin : float
        Factor, from audits: a PSF may be brighter at another wavelength of the band, or with some
        of the panel's effects, than with all of them or with none.
    frequency_factor : float
        Factor by which frequencies around one are searched for the largest modulus, for the same
        reason.
    """

    margin: float = 1.3
    frequency_factor: float = 1.1


_SETTINGS = PSFBoundSettings()


def has_known_psf(s: Situation) -> bool:
    """Whether effects' bounds may use the probed PSF: one distance, and no layer hides another."""
    return len(set(s.picture_probe.distances)) == 1 and not has_occlusion(s)


def has_occlusion(s: Situation) -> bool:
    """Whether the occlusion effect can occur: any layer of the target hides another."""
    return any(layer.cover is not None for layer in s.target.layers)


@cached_per_situation
def peak_pixel_share(s: Situation) -> float:
    """Bound the share of a point's light on one pixel under any effects; 1 for an unknown PSF."""
    if not has_known_psf(s):
        return 1.0
    return _on_pixel(s, s.pattern_probe.peak)


@cached_per_situation
def psf_energy_bound(s: Situation, beyond: float = 0.0) -> float:
    """Bound the sum over pixels of a PSF's squared shares, under any effects.

    beyond: if given, only the light beyond a square of so many metres to each side counts.
    """
    if not has_known_psf(s):
        return 1.0
    return _on_pixel(
        s,
        s.pattern_probe.squared_density_beyond(beyond)
        if beyond
        else s.pattern_probe.squared_density,
    )


def _on_pixel(s: Situation, density: float) -> float:
    """Bound a PSF's share on one pixel under any effects from its density at the centre.

    density: the PSF's in 1/m², in the middle of band and field. The bound holds over the whole band
    and field.
    """
    density *= _brighter(s)
    if s.camera.separation:
        # Off the axis, light passes another part of the panel: amplitudes add.
        lit = (
            open_area(s.mount.camera_in_panel_axes(s.camera))
            / (s.wavelength * as_number(s.camera.ray_matrix_b)) ** 2
        )
        density = (math.sqrt(density) + illuminated_area_change(s) * math.sqrt(lit)) ** 2
    return min(density * s.camera.sensor.pitch**2, 1.0)


def zeroth_order_share(s: Situation) -> float:
    """Bound the share of a point's light that the panel orders effect keeps on the sensor."""
    if can_orders_reach_sensor(s) or is_uniform_scene(s):
        return 1.0
    return min(1.05 * s.pattern_probe.zeroth_order_share, 1.0)


def can_orders_reach_sensor(s: Situation) -> bool:
    """Whether the panel orders effect can occur: side orders of any light can reach a pixel.

    The first order begins half a period from the light's image.
    """
    shortest = min(s.band.support[0], s.band.leak_range[0] if s.band.leak else math.inf)
    period = s.pattern_probe.period * shortest / s.wavelength
    return max(max_blur_distance(s)) + ORDER_FADE_PIXELS * s.camera.sensor.pitch > period / 2


def _brighter(s: Situation) -> float:
    """Return how much denser PSFs are at the band's short end, for bounds on effects.

    The result is relative to the band's centre.
    """
    return _SETTINGS.margin * s.band.centre**2 / s.band.support[0] ** 2


def mtf_bound(s: Situation, frequency: Array) -> Array:
    """Bound the MTF ``|H|`` of any PSF under any effects, at cycles per metre on the sensor."""
    if not has_known_psf(s):
        return np.ones_like(frequency)
    spread = _SETTINGS.frequency_factor * s.band.support[1] / s.band.support[0]
    most = _SETTINGS.margin * s.pattern_probe.transfer_bounds.modulus_bound(
        frequency.ravel(), spread
    )
    if s.camera.separation:
        differs = illuminated_area_change(s)
        most = most + 2 * math.sqrt(differs) + differs
    return np.minimum(most, 1.0).reshape(frequency.shape)


def illuminated_area_change(s: Situation) -> float:
    """Return the panel area lit from only one of axis and field corner, for off-axis effects.

    The area is relative to the one that is lit from the axis. A shadow that moves by v changes v
    times its width on either side.
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


@cached_per_situation
def max_vignetting_change(s: Situation) -> float:
    """Return the vignetting effect's largest relative change of a point's light.

    The change is computed at a few places of the frame and its margin, the corners included.
    """
    distances = {min(s.picture_probe.distances), max(s.picture_probe.distances)}
    return float((vignetting_samples(s, s.picture_probe.plane.shape, distances) - 1).abs().max())


def vignetting_samples(
    s: Situation, shape: Sequence[int], distances: Collection[float]
) -> torch.Tensor:
    """Sample the vignetting effect: return the share of the light left, for each distance.

    The share is computed at 9 x 9 places from corner to corner of `shape` pixels. A curve of
    relative illumination that rises again counts with the least light so far, which the places
    then can't miss.
    """
    camera = _with_falling_light(s.mount.camera_in_panel_axes(s.camera))
    rows, columns = (n * camera.sensor.pitch / 8 for n in shape)
    plane = Plane((9, 9), (rows, columns))
    # It doesn't depend on the pattern, and may take a tenth of a second.
    known = s.picture_probe.results
    causes = [("vignetting", camera, s.mount, plane, distance) for distance in distances]
    for cause in causes:
        if cause not in known:
            known[cause] = vignetting(camera, s.mount, plane, cause[-1])
    return torch.stack([known[cause] for cause in causes])


def _with_falling_light(camera: Camera) -> Camera:
    """Return the camera with a curve of relative illumination that nowhere rises outwards."""
    curve = camera.lens.relative_illumination
    if not curve:
        return camera
    heights, shares = zip(*curve, strict=True)
    falling = tuple(zip(heights, itertools.accumulate(shares, min), strict=True))
    return replace(camera, lens=replace(camera.lens, relative_illumination=falling))


def is_uniform_scene(s: Situation) -> bool:
    """Whether blur has no effect: all light is uniform and endless, and no layer hides another."""
    parts = [part.picture for layer in s.target.layers for part in layer.parts]
    return (
        bool(parts) and all(isinstance(one, UniformLight) for one in parts) and not has_occlusion(s)
    )


def blur_sensitivity(s: Situation) -> float:
    """Return the largest share of the light that effects on the PSF can change.

    In uniform, endless light, they change only what vignetting and the filter's angle make of it.
    """
    if not is_uniform_scene(s):
        return 1.0
    aslant = 1 - float(angle_shares(s).min())
    return min(max_vignetting_change(s) + aslant, 1.0)
