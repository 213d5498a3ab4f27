"""Layers at several depths: each is out of focus by its distance, and hides what is behind it."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from optics.camera import Camera, Panel
from optics.camera.pupil import object_to_lens_distance
from optics.validation import as_number
from simulator.effects.electron_bounds import max_light_seconds, sensor_error_bound
from simulator.effects.light_effects import LightEffect
from simulator.effects.rendering_work import (
    ATTRIBUTION_ORDER,
    DEPTH_LAYERS,
    LEVELS,
    OCCLUSION,
    channel_count_at,
    first_level_reaching,
    picture_transform_operations,
    place_count_at,
    rendering_operations,
    wavelength_count_at,
)
from simulator.formation.nodes import depth_nodes
from simulator.planning import Bound, OnOffEffect
from simulator.probing.sampled_frequencies import Gain
from simulator.situation import Situation

Array = NDArray[np.float64]


class DepthLayers(LightEffect):
    name = DEPTH_LAYERS
    likely_shares = (0.2,)
    kind = "axis"
    recipe_field, recipe_values = "depths", LEVELS.depths
    physics = "what isn't in focus is blurred by its distance from the plane that is"
    source = "defocus as a phase over the pupil; Hopkins 1955, doi 10.1098/rspa.1955.0158"
    levels = tuple(str(n) for n in LEVELS.depths)

    def is_caused(self, s: Situation) -> bool:
        return len(set(s.picture_probe.distances)) > 1

    def finest_level(self, s: Situation) -> int:
        return first_level_reaching(LEVELS.depths, len(set(s.picture_probe.distances)))

    def estimated_error(self, s: Situation, level: int) -> float:
        whole = s.picture_probe.norm_bound
        if not whole or level >= self.finest_level(s):
            return 0.0
        return 0.5 * self._change(s, level) / whole

    def error_bound_below_finest(self, s: Situation, level: int) -> Bound:
        change = self._change(s, level) + self._change(s, self.finest_level(s))
        how = "proved: phases of two points of the pupil differ by 2π k ρ at most"
        return sensor_error_bound(s, change * max_light_seconds(s), how)

    def added_operations(self, s: Situation, levels: Mapping[str, int]) -> float:
        """Return the operations that more distances take, with all else at its lowest level."""
        bare = {**dict.fromkeys(ATTRIBUTION_ORDER, 0), self.name: levels[self.name]}
        return rendering_operations(s, bare) - rendering_operations(s, {**bare, self.name: 0})

    def explain(self, s: Situation) -> str:
        near, far = min(s.picture_probe.distances), max(s.picture_probe.distances)
        blur = 2 * _displacement(s.camera, near, far) / s.camera.sensor.pitch
        return f"from {near:.3g} to {far:.3g} m the blur changes by {blur:.3g} pixels"

    def _change(self, s: Situation, level: int) -> float:
        """Bound the L2 error at a level, in electrons per second."""
        probe, beside = s.picture_probe, math.hypot(*s.mount.shift)
        nodes = depth_nodes(probe.distances, LEVELS.depths[level])
        return probe.change_bound([_gain(s.camera, d, nodes[d], beside) for d in probe.distances])


def _gain(
    camera: Camera, distance: float, nodes: list[tuple[float, float]], beside: float = 0.0
) -> Gain:
    """Bound the error of one layer's transfer function, by frequency.

    Light from the pupil's rim lands elsewhere by ρ. Between two nodes the mean is linear in the
    defocus; the transfer function's second derivative by the defocus is at most (2π k R)², so that
    the mean misses an eighth of that times the squared step between the nodes.
    nodes: the distances whose PSFs' weighted mean stands for the layer's, and their weights.
    beside: metres from the lens' axis to the panel's middle.
    """
    moved = [_displacement(camera, distance, node, beside) for node, _ in nodes]
    first = sum(share * rho for rho, (_, share) in zip(moved, nodes, strict=True))
    step = _displacement(camera, nodes[0][0], nodes[-1][0], beside) if len(nodes) > 1 else 0.0
    shadow = max((_shadow_change_share(camera, distance, node) for node, _ in nodes), default=0.0)

    def gain(k: Array) -> Array:
        phase = 2 * np.pi * k * first
        if step:
            phase = np.minimum(phase, (2 * np.pi * k * step) ** 2 / 8)
        return np.minimum(2.0, phase + shadow)

    return gain


def _displacement(camera: Camera, one: float, other: float, beside: float = 0.0) -> float:
    """Return how many metres light moves on the sensor between two object distances.

    It comes from the rim of the panel, or of the stop's shadow on it, which may be `beside` metres
    farther from the axis.
    """
    bent = abs(_wave_curvature(camera, one) - _wave_curvature(camera, other))
    half = _half_diagonal(camera.panel)
    radius = min(half, max(_stop_shadow_radius(camera, one), _stop_shadow_radius(camera, other)))
    return as_number(camera.ray_matrix_b) * bent * (radius + beside)


def _wave_curvature(camera: Camera, distance: float) -> float:
    """Return the curvature that the lens leaves of a point's wave on the panel (defocus), 1/m."""
    spread = 1 + as_number(camera.separation) / distance
    focus, image = as_number(camera.lens.focus_distance), as_number(camera.lens.image_distance)
    vergence = 1 / object_to_lens_distance(camera, distance) - 1 / focus
    return as_number(spread * image / as_number(camera.ray_matrix_b) * vergence)


def _stop_shadow_radius(camera: Camera, distance: float) -> float:
    """Return the radius of the stop's shadow on the panel, in metres."""
    return as_number(camera.lens.stop_diameter) / 2 / (1 + as_number(camera.separation) / distance)


def _half_diagonal(panel: Panel) -> float:
    """Return the metres from the panel's middle to its corners."""
    return math.hypot(*(n * panel.pitch / 2 for n in panel.shape))


def _shadow_change_share(camera: Camera, one: float, other: float) -> float:
    """Bound the share of a layer's light that moves when the stop's shadow resizes."""
    if as_number(camera.separation) == 0:
        return 0.0
    half = _half_diagonal(camera.panel)
    radii = sorted(min(_stop_shadow_radius(camera, d), half) for d in (one, other))
    return 2 * math.sqrt(2 * (1 - (radii[0] / radii[1]) ** 2))


class Occlusion(LightEffect, OnOffEffect):
    name = OCCLUSION
    likely_shares = (0.5,)
    recipe_field = "occlusion"
    physics = "what is near hides what is behind it, and more of it where it is blurred"
    source = "Hasinoff and Kutulakos 2007, doi 10.1109/ICCV.2007.4408910"

    def is_caused(self, s: Situation) -> bool:
        return any(one is not None and bool(one.any()) for one in s.picture_probe.covers) and any(
            bool(light.any()) for light in s.picture_probe.lights[1:]
        )

    def estimated_error_if_omitted(self, s: Situation) -> float:
        """Estimate the sharp picture's relative error if all layers are transparent."""
        whole = s.picture_probe.norm_bound
        if not whole:
            return 0.0
        transparent = torch.stack(s.picture_probe.lights).sum(0)
        return float((transparent - s.picture_probe.sharp_picture).double().norm()) / whole

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        """Bound the light that near layers should hide.

        It is at most a layer's blurred light times the blurred covers before it. It consists of
        light that starts within twice a PSF's reach of a cover, and of the shares of light and
        covers that fall beyond the reach: the least of the bounds for several shares.
        """
        how = "proved: light behind, as far as a PSF reaches from what hides, and what falls beyond"
        hidden = min(self._hidden_light_within(s, share) for share in (1e-1, 1e-2, 1e-3, 1e-4))
        return sensor_error_bound(s, max_light_seconds(s) * hidden, how)

    def added_operations(self, s: Situation, levels: Mapping[str, int]) -> float:
        """Return the operations beyond those of simply summing the layers' light.

        For every wavelength, each layer's transfer function is transformed, for its light and its
        cover, and so are the pictures of both.
        """
        if not levels[self.name]:
            return 0.0
        channels, nodes = channel_count_at(s, levels), wavelength_count_at(levels)
        places, layers = place_count_at(levels), s.target.layers
        covers = sum(one is not None for one in s.picture_probe.covers)
        pictures = covers + len(layers) * channels
        each = places * (covers + len(layers)) + pictures
        added = places * sum(min(nodes, len(one.parts) * channels) for one in layers)
        return (nodes * each + covers + channels - added) * picture_transform_operations(s, levels)

    def explain(self, s: Situation) -> str:
        edges = s.picture_probe.edge_length / s.camera.sensor.pitch
        return f"near things hide what is behind them along {edges:.3g} pixels of edges"

    def _hidden_light_within(self, s: Situation, share: float) -> float:
        """Bound the L2 norm of the hidden light, electrons/s, by a reach that misses `share`."""
        picture, pattern = s.picture_probe, s.pattern_probe
        pixels = math.ceil(pattern.reach_of_share(share) / s.camera.sensor.pitch)
        far = max(n * p for n, p in zip(picture.plane.shape, picture.plane.pitch, strict=True))
        aside = pattern.side_order_share if pattern.period / 2 < far else 0.0
        beyond = min(share + aside, 1.0)
        hidden, total = torch.zeros(picture.plane.shape, dtype=torch.uint8), 0.0
        for light, cover in zip(picture.lights, picture.covers, strict=True):
            all_of_it = float(light.double().norm())
            if hidden.any() and all_of_it:
                near = float((light * _dilate_mask(hidden, 2 * pixels)).double().norm())
                total += min(near + 2 * beyond * all_of_it, all_of_it)
            if cover is not None:
                hidden |= (cover > 0).to(torch.uint8)
        return total


def _dilate_mask(mask: torch.Tensor, pixels: int) -> torch.Tensor:
    """Grow a mask by a square of `pixels` to each side."""
    values = mask.numpy()
    for axis, n in enumerate(values.shape):
        values = maximum_filter1d(values, min(2 * pixels + 1, 2 * n + 1), axis, mode="constant")
    return torch.from_numpy(values)
