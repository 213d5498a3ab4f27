"""Things at different distances, each out of focus by its own."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from optics.camera import Camera
from optics.edge import as_number
from optics.pupil import lens_distance
from simulator.effects.costs import DEPTHS, ORDER, operations
from simulator.effects.on_pixels import seconds, through_sensor
from simulator.formation.nodes import depth_nodes
from simulator.planning import Bound, Effect
from simulator.probing.radial import Gain
from simulator.situation import Situation


class DepthLayers(Effect):
    name = "depth layers"
    kind = "axis"
    entry, values = "depths", DEPTHS
    physics = "what isn't in focus is blurred by its distance from the plane that is"
    source = "defocus as a phase over the pupil; Hopkins 1955, doi 10.1098/rspa.1955.0158"
    levels = tuple(str(n) for n in DEPTHS)

    def caused(self, s: Situation) -> bool:
        return len(set(s.picture.distances)) > 1 and not s.picture.dark

    def finest(self, s: Situation) -> int:
        enough = [k for k, n in enumerate(DEPTHS) if n >= len(set(s.picture.distances))]
        return enough[0] if enough else len(DEPTHS) - 1

    def estimate(self, s: Situation, level: int) -> float:
        whole = s.picture.l2
        return 0.5 * self._change(s, level) / whole if whole and level < self.finest(s) else 0.0

    def coarser(self, s: Situation, level: int) -> Bound:
        change = self._change(s, level) + self._change(s, self.finest(s))
        how = "proved: phases of two points of the pupil differ by 2π k ρ at most"
        return through_sensor(s, change * seconds(s), how)

    def work(self, s: Situation, levels: Mapping[str, int]) -> float:
        """Of PSFs of distances beyond one; what effects make of each is their own."""
        bare = {**dict.fromkeys(ORDER, 0), self.name: levels[self.name]}
        return operations(s, bare) - operations(s, {**bare, self.name: 0})

    def why(self, s: Situation) -> str:
        near, far = min(s.picture.distances), max(s.picture.distances)
        blur = 2 * _displacement(s.camera, near, far) / s.camera.sensor.pitch
        return f"from {near:.3g} to {far:.3g} m the blur changes by {blur:.3g} pixels"

    def _change(self, s: Situation, level: int) -> float:
        distances = s.picture.distances
        nodes = depth_nodes(distances, DEPTHS[level])
        return s.picture.changed([_gain(s.camera, d, nodes[d]) for d in distances])


def _gain(camera: Camera, distance: float, nodes: list[tuple[float, float]]) -> Gain:
    """Of a layer whose PSF is a mean of those at other distances.

    Light from the pupil's rim lands elsewhere by ρ. Between two nodes the mean is linear, and
    the transfer function's second derivative by defocus is (2π k R)² at most: of a step from
    one node to the other it misses an eighth.
    """
    moved = [_displacement(camera, distance, node) for node, _ in nodes]
    first = sum(share * rho for rho, (_, share) in zip(moved, nodes, strict=True))
    step = _displacement(camera, nodes[0][0], nodes[-1][0]) if len(nodes) > 1 else 0.0
    shadow = max((_shadows_differ(camera, distance, node) for node, _ in nodes), default=0.0)

    def gain(k: NDArray[np.float64]) -> NDArray[np.float64]:
        phase = 2 * np.pi * k * first
        if step:
            phase = np.minimum(phase, (2 * np.pi * k * step) ** 2 / 8)
        return np.minimum(2.0, phase + shadow)

    return gain


def _displacement(camera: Camera, one: float, other: float) -> float:
    """Metres on the sensor by which light from the rim of the panel, or of the stop's shadow,
    lands elsewhere for one distance than for another."""
    bent = abs(_bent(camera, one) - _bent(camera, other))
    panel = camera.panel
    half = math.hypot(*(n * panel.pitch / 2 for n in panel.shape))
    radius = min(half, max(_shadow(camera, one), _shadow(camera, other)))
    return as_number(camera.lever) * bent * radius


def _bent(camera: Camera, distance: float) -> float:
    """Curvature of the wave over the panel that the lens leaves, 1/m."""
    spread = 1 + as_number(camera.separation) / distance
    vergence = 1 / lens_distance(camera, distance) - 1 / as_number(camera.lens.focus_distance)
    return as_number(
        spread * as_number(camera.lens.image_distance) / as_number(camera.lever) * vergence
    )


def _shadow(camera: Camera, distance: float) -> float:
    """Radius on the panel of what the stop lets pass, metres."""
    return as_number(camera.lens.stop_diameter) / 2 / (1 + as_number(camera.separation) / distance)


def _shadows_differ(camera: Camera, one: float, other: float) -> float:
    """Of the light, what another size of the stop's shadow gives to other places, at most."""
    if as_number(camera.separation) == 0:
        return 0.0
    panel = camera.panel
    half = math.hypot(*(n * panel.pitch / 2 for n in panel.shape))
    radii = sorted(min(_shadow(camera, d), half) for d in (one, other))
    return 2 * math.sqrt(2 * (1 - (radii[0] / radii[1]) ** 2))
