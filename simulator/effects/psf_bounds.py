"""Bounds of a PSF's spread and reach that hold whatever else is on.

They hold for waves; the error of replacing waves by rays is counted separately.

With field aberrations, the light of a point is a wave in the pupil, u exp(i k W), whatever the
panel shows. Its PSF is linear in the projector on that wave. So the L1 norm of any combination of
PSFs of several places is at most the trace norm of the same combination of projectors, which no
pattern changes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray

from optics.camera.pupil import open_area, share_through_stop
from optics.validation import as_number
from simulator.effects.result_cache import cached_across_patterns, cached_per_situation
from simulator.formation.nodes import field_nodes, interpolation_weights
from simulator.formation.windows import ORDER_FADE_PIXELS, max_blur_distance
from simulator.scene.drawable import UniformLight
from simulator.situation import Situation

Array = NDArray[np.float64]
Place = tuple[float, float]

# Factor by which a PSF may be brighter, from audits, at another wavelength of the band, or with
# some of the panel's imperfections, than with all of them or with none; and factor by which
# frequencies around one are searched for the largest modulus, for the same reason.
_MARGIN, _FREQUENCY_FACTOR = 1.3, 1.1

# Pixels of the panel along each axis, at most, at which waves are compared. Field aberrations are
# polynomials of third degree, smooth between them. Chosen.
_PIXELS = 48

# Heights, over the largest, at which waves are compared with the axis: coma and curvature may
# cancel in part. Chosen.
_HEIGHTS = (0.25, 0.5, 0.75, 1.0)


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


def _trace_norm(gram: NDArray[np.complex128], shares: Array) -> float:
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


def _phases(s: Situation, places: Sequence[Place]) -> Array:
    """Return field aberrations' largest phases at open pixels of the panel, (places, pixels)."""
    by, lens, mount = s.camera.lens.field_aberrations, s.camera.lens, s.mount
    assert by is not None
    down, along = _compared_pixels(s)
    spread = 1 + as_number(s.camera.separation) / min(s.picture_probe.distances)
    y, x = (one.numpy() for one in s.camera.panel.plane.mesh())
    v, u = mount.places_on_sensor(*np.broadcast_arrays(y[down], x[:, along]))
    radius = as_number(lens.stop_diameter) / 2 / spread
    v, u = (v + mount.shift[0]) / radius, (u + mount.shift[1]) / radius
    open_ = _aperture(s) > 0
    wave = 2 * math.pi / s.band.support[0]
    return np.stack([wave * by.path(place, v[open_], u[open_]) for place in places])


def _weights(s: Situation) -> Array:
    """Return each open pixel's share of a point's light."""
    opened, panel = _aperture(s), s.camera.panel
    share = opened
    if panel.illumination is not None:
        share = opened * np.sqrt(panel.illumination.at_pixels(panel)[_compared_pixels(s)].numpy())
    light = share[opened > 0] ** 2
    total: float = light.sum()
    return np.asarray(light / total if total else light)


def _aperture(s: Situation) -> Array:
    share: torch.Tensor = s.pattern_probe.aperture_share[_compared_pixels(s)]
    return np.asarray(share.to(torch.float64).numpy())


def _compared_pixels(s: Situation) -> tuple[slice, slice]:
    down, along = (slice(None, None, max(1, n // _PIXELS)) for n in s.camera.panel.shape)
    return down, along
