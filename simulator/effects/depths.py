"""Layers at several depths: each is out of focus by its distance."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from optics.camera import Camera
from optics.camera.pupil import object_to_lens_distance
from optics.validation import as_number
from simulator.effects.electron_bounds import max_light_seconds, sensor_error_bound
from simulator.effects.likely_errors import LightEffect
from simulator.effects.rendering_work import ATTRIBUTION_ORDER, LEVELS, rendering_operations
from simulator.formation.nodes import depth_nodes
from simulator.planning import Bound
from simulator.probing.sampled_frequencies import Gain
from simulator.situation import Situation


class DepthLayers(LightEffect):
    name = "depth layers"
    likely_shares = (0.2,)
    kind = "axis"
    recipe_field, recipe_values = "depths", LEVELS.depths
    physics = "what isn't in focus is blurred by its distance from the plane that is"
    source = "defocus as a phase over the pupil; Hopkins 1955, doi 10.1098/rspa.1955.0158"
    levels = tuple(str(n) for n in LEVELS.depths)

    def is_present(self, s: Situation) -> bool:
        return len(set(s.picture_probe.distances)) > 1 and not s.picture_probe.is_dark

    def finest_level(self, s: Situation) -> int:
        enough = [
            k for k, n in enumerate(LEVELS.depths) if n >= len(set(s.picture_probe.distances))
        ]
        return enough[0] if enough else len(LEVELS.depths) - 1

    def estimated_error(self, s: Situation, level: int) -> float:
        whole = s.picture_probe.norm_bound
        return (
            0.5 * self._change(s, level) / whole if whole and level < self.finest_level(s) else 0.0
        )

    def error_bound_below_finest(self, s: Situation, level: int) -> Bound:
        change = self._change(s, level) + self._change(s, self.finest_level(s))
        how = "proved: phases of two points of the pupil differ by 2π k ρ at most"
        return sensor_error_bound(s, change * max_light_seconds(s), how)

    def added_operations(self, s: Situation, levels: Mapping[str, int]) -> float:
        """Return the operations that the PSFs of more distances take.

        Everything else is taken at its lowest level.
        """
        bare = {**dict.fromkeys(ATTRIBUTION_ORDER, 0), self.name: levels[self.name]}
        return rendering_operations(s, bare) - rendering_operations(s, {**bare, self.name: 0})

    def explain(self, s: Situation) -> str:
        near, far = min(s.picture_probe.distances), max(s.picture_probe.distances)
        blur = 2 * _displacement(s.camera, near, far) / s.camera.sensor.pitch
        return f"from {near:.3g} to {far:.3g} m the blur changes by {blur:.3g} pixels"

    def _change(self, s: Situation, level: int) -> float:
        """Bound the L2 error at a level, in electrons per second."""
        distances = s.picture_probe.distances
        nodes = depth_nodes(distances, LEVELS.depths[level])
        beside = math.hypot(*s.mount.shift)
        return s.picture_probe.change_bound(
            [_gain(s.camera, d, nodes[d], beside) for d in distances]
        )


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

    def gain(k: NDArray[np.float64]) -> NDArray[np.float64]:
        phase = 2 * np.pi * k * first
        if step:
            phase = np.minimum(phase, (2 * np.pi * k * step) ** 2 / 8)
        return np.minimum(2.0, phase + shadow)

    return gain


def _displacement(camera: Camera, one: float, other: float, beside: float = 0.0) -> float:
    """Return how many metres rim light moves on the sensor between two object distances.

    Rim light comes from the edge of the panel, or of the stop's shadow on it.
    beside: metres from the lens' axis to the panel's middle, by which the rim may be farther from
        the axis.
    """
    bent = abs(_wave_curvature(camera, one) - _wave_curvature(camera, other))
    panel = camera.panel
    half = math.hypot(*(n * panel.pitch / 2 for n in panel.shape))
    radius = min(half, max(_stop_shadow_radius(camera, one), _stop_shadow_radius(camera, other)))
    return as_number(camera.ray_matrix_b) * bent * (radius + beside)


def _wave_curvature(camera: Camera, distance: float) -> float:
    """Return the curvature that the lens leaves of a point's wave on the panel (defocus), 1/m."""
    spread = 1 + as_number(camera.separation) / distance
    vergence = 1 / object_to_lens_distance(camera, distance) - 1 / as_number(
        camera.lens.focus_distance
    )
    return as_number(
        spread * as_number(camera.lens.image_distance) / as_number(camera.ray_matrix_b) * vergence
    )


def _stop_shadow_radius(camera: Camera, distance: float) -> float:
    """Return the radius of the stop's shadow on the panel, in metres."""
    return as_number(camera.lens.stop_diameter) / 2 / (1 + as_number(camera.separation) / distance)


def _shadow_change_share(camera: Camera, one: float, other: float) -> float:
    """Bound the share of a layer's light that moves when the stop's shadow resizes."""
    if as_number(camera.separation) == 0:
        return 0.0
    panel = camera.panel
    half = math.hypot(*(n * panel.pitch / 2 for n in panel.shape))
    radii = sorted(min(_stop_shadow_radius(camera, d), half) for d in (one, other))
    return 2 * math.sqrt(2 * (1 - (radii[0] / radii[1]) ** 2))
