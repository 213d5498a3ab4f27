"""Bounds of what vignetting takes: in the frame, and where side orders bring light from."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Sequence
from dataclasses import replace

import torch

from optics.camera import Camera
from optics.plane import Plane
from simulator.effects.psf_bounds import is_uniform_scene
from simulator.effects.rendering_work import LEVELS
from simulator.effects.result_cache import cached_across_patterns, cached_per_situation
from simulator.effects.spectra import angle_shares
from simulator.formation.objects import vignetting
from simulator.formation.windows import light_extent
from simulator.situation import Situation


@cached_per_situation
def max_vignetting_change(s: Situation) -> float:
    """Return the largest change of a point's light, wherever side orders bring light from."""
    return _vignetting_change(s, LEVELS.orders[-1])


@cached_per_situation
def vignetting_change(s: Situation) -> float:
    """Bound the relative change by vignetting of light that reaches the frame on all ways.

    Light of the frame and its margin counts with the change there; that of side orders comes from
    farther aside, and counts with its share.
    """
    found = _vignetting_change(s, 0)
    for order in range(1, LEVELS.orders[-1] + 1):
        more = _vignetting_change(s, order) - _vignetting_change(s, order - 1)
        found += s.pattern_probe.beyond_orders(order - 1) * more if more else 0.0
    return found


def _vignetting_change(s: Situation, orders: int) -> float:
    """Return the largest change at places where light up to some side order comes from."""
    plane = s.picture_probe.plane
    period = s.pattern_probe.period * s.band.whole_support[1] / s.wavelength
    turned = abs(math.cos(s.mount.rotation)) + abs(math.sin(s.mount.rotation))
    aside = (orders + 0.5) * period * turned if orders else 0.0
    shape = [
        n + 2 * max(0, math.ceil(min(far, n * pitch / 2 + aside) / pitch - n / 2))
        for n, pitch, far in zip(plane.shape, plane.pitch, light_extent(s), strict=True)
    ]
    distances = {min(s.picture_probe.distances), max(s.picture_probe.distances)}
    return float((vignetting_samples(s, shape, distances) - 1).abs().max())


def vignetting_samples(
    s: Situation, shape: Sequence[int], distances: Collection[float]
) -> torch.Tensor:
    """Return the share of the light that vignetting leaves at 9 x 9 places, for each distance.

    The places go from corner to corner of `shape` pixels. A curve of relative illumination that
    rises again counts with the least light so far, which the places then can't miss.
    """
    camera = s.mount.camera_in_panel_axes(s.camera)
    if camera.lens.relative_illumination:
        heights, shares = zip(*camera.lens.relative_illumination, strict=True)
        falling = tuple(zip(heights, itertools.accumulate(shares, min), strict=True))
        camera = replace(camera, lens=replace(camera.lens, relative_illumination=falling))
    rows, columns = (n * camera.sensor.pitch / 8 for n in shape)
    plane = Plane((9, 9), (rows, columns))
    return torch.stack([_vignetting_at(s, camera, plane, distance) for distance in distances])


@cached_across_patterns
def _vignetting_at(s: Situation, camera: Camera, plane: Plane, distance: float) -> torch.Tensor:
    """Return what vignetting() returns, which may take a tenth of a second."""
    return vignetting(camera, s.mount, plane, distance)


def blur_sensitivity(s: Situation) -> float:
    """Return the largest share of the light, in uniform light a small one, that PSFs can change."""
    return min(max_vignetting_change(s) + _aslant(s), 1.0) if is_uniform_scene(s) else 1.0


def unevenness(s: Situation) -> float:
    """Bound the share of the light by which the picture differs from an even one."""
    return min(vignetting_change(s) + _aslant(s), 1.0) if is_uniform_scene(s) else 1.0


def _aslant(s: Situation) -> float:
    """Return the largest share of the light that its angle to the filter takes."""
    return 1 - float(angle_shares(s).min())
