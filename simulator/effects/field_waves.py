"""How far waves of points off the axis are from those of the axis, by the lens' field aberrations.

The light of a point is a wave in the pupil, u exp(i k W), whatever the panel shows. Its PSF is
linear in the projector on that wave. So the L1 norm of any combination of PSFs of several places is
at most the trace norm of the same combination of projectors, which no pattern changes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray

from optics.validation import as_number
from simulator.effects.result_cache import cached_across_patterns, cached_per_situation
from simulator.formation.nodes import field_nodes, interpolation_weights
from simulator.situation import Situation

Place = tuple[float, float]

_PIXELS = 48
"""Pixels of the panel along each axis, at most, at which waves are compared. Field aberrations are
polynomials of third degree, smooth between them. Chosen."""

_HEIGHTS = (0.25, 0.5, 0.75, 1.0)
"""Heights, over the largest, at which waves are compared with the axis: coma and curvature may
cancel in part. Chosen."""


def wave_distance(s: Situation) -> float:
    """Bound the L2 norm of a field-aberrated wave's difference from the axis', a turn left out."""
    return math.sqrt(2 * (1 - _least_coherence(s)))


def psf_change(s: Situation) -> float:
    """Bound ‖Δh‖₁ of PSFs over the field against that of the axis, by field aberrations."""
    return 2 * math.sqrt(max(1 - _least_coherence(s) ** 2, 0.0))


def phase_span(s: Situation) -> float:
    """Return the radians that field aberrations span in the frame's corner, at most."""
    return float(np.ptp(_phases(s, [_corner(s)])))


def displacement(s: Situation) -> float:
    """Bound how far field aberrations displace a ray on the sensor, in metres."""
    by = s.camera.lens.field_aberrations
    if by is None:
        return 0.0
    h = math.hypot(*_corner(s)) / by.height
    # The slopes of v² (v·H), (v·H)² and v² H² are at most 3 H, 2 H² and 2 H² within the stop.
    slope = 3 * h * abs(by.coma) + 2 * h**2 * (abs(by.astigmatism) + abs(by.curvature))
    return slope / as_number(s.camera.lens.image_numerical_aperture)


@cached_across_patterns
def interpolation_error(s: Situation, count: int) -> float:
    """Bound ‖Δh‖₁ of PSFs that are interpolated between `count` places along each axis.

    It is found in the middles between the outermost places, where polynomials err most.
    """
    half = _corner(s)
    nodes = [field_nodes(count, one) for one in half]
    places = [(y, x) for y in nodes[0] for x in nodes[1]]
    between = [
        [(a + b) / 2 for a, b in pairwise(list(one)[-3:])] if len(one) > 1 else [one[0]]
        for one in nodes
    ]
    tried = [(y, x) for y in between[0] for x in between[1]]
    waves = np.exp(1j * _phases(s, places + tried)) * np.sqrt(_weights(s))
    gram = waves @ waves.conj().T
    n, worst = len(places), 0.0
    for k, (y, x) in enumerate(tried):
        down, along = (
            interpolation_weights(axis, np.array([at]))[:, 0]
            for axis, at in zip(nodes, (y, x), strict=True)
        )
        mixed = np.append(-np.outer(down, along).ravel(), 1.0)
        chosen = np.append(np.arange(n), n + k)
        worst = max(worst, _trace_norm(gram[np.ix_(chosen, chosen)], mixed))
    return worst


def _trace_norm(gram: NDArray[np.complex128], shares: NDArray[np.float64]) -> float:
    """Return the trace norm of the sum of projectors on waves, times shares, by their products."""
    values, vectors = np.linalg.eigh(gram)
    root = vectors * np.sqrt(np.maximum(values, 0))
    # Waves of few independent shapes span few dimensions: the others hold rounding alone.
    root = root[:, values > 1e-13 * values[-1]]
    return float(np.abs(np.linalg.eigvalsh(root.conj().T @ (shares[:, None] * root))).sum())


@cached_per_situation
def _least_coherence(s: Situation) -> float:
    """Return the least overlap of the axis' wave with those of the frame's corners and sides."""
    if s.camera.lens.field_aberrations is None:
        return 1.0
    y, x = _corner(s)
    ends = ((y, x), (y, -x), (y, 0.0), (0.0, x))
    places = [(share * v, share * u) for v, u in ends for share in _HEIGHTS]
    turned = np.exp(1j * _phases(s, places)) @ _weights(s)
    return min(float(np.abs(turned).min()), 1.0)


def _corner(s: Situation) -> Place:
    """Return the place of the frame's corner; PSFs beside the frame are those of its edge."""
    y, x = (n * s.camera.sensor.pitch / 2 for n in s.camera.sensor.shape)
    return y, x


def _phases(s: Situation, places: Sequence[Place]) -> NDArray[np.float64]:
    """Return field aberrations' largest phases at open pixels of the panel, (places, pixels)."""
    by, lens, mount = s.camera.lens.field_aberrations, s.camera.lens, s.mount
    assert by is not None
    rows, columns = _steps(s)
    spread = 1 + as_number(s.camera.separation) / min(s.picture_probe.distances)
    y, x = (one.numpy() for one in s.camera.panel.plane.mesh())
    v, u = mount.places_on_sensor(*np.broadcast_arrays(y[::rows], x[:, ::columns]))
    radius = as_number(lens.stop_diameter) / 2 / spread
    v, u = (v + mount.shift[0]) / radius, (u + mount.shift[1]) / radius
    open_ = _aperture(s) > 0
    wave = 2 * math.pi / s.band.support[0]
    return np.stack([wave * by.path(place, v[open_], u[open_]) for place in places])


def _weights(s: Situation) -> NDArray[np.float64]:
    """Return each open pixel's share of a point's light."""
    share = _aperture(s)
    panel = s.camera.panel
    if panel.illumination is not None:
        rows, columns = _steps(s)
        lit = panel.illumination.at_pixels(panel)[::rows, ::columns].numpy()
        share = share * np.sqrt(lit)
    light = share[_aperture(s) > 0] ** 2
    total: float = light.sum()
    return np.asarray(light / total if total else light)


def _aperture(s: Situation) -> NDArray[np.float64]:
    rows, columns = _steps(s)
    share: torch.Tensor = s.pattern_probe.aperture_share[::rows, ::columns]
    return np.asarray(share.to(torch.float64).numpy())


def _steps(s: Situation) -> tuple[int, int]:
    rows, columns = (max(1, n // _PIXELS) for n in s.camera.panel.shape)
    return rows, columns
