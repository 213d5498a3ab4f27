"""The light of a band by wavelength, and how well a few wavelengths stand for it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from optics.light import Spectrum
from simulator.formation.nodes import (
    density,
    fine_points,
    interpolating,
    mean_curve,
    place_weights,
    seen_range,
)

if TYPE_CHECKING:
    from simulator.situation import Situation

Array = NDArray[np.float64]

_NODES = 49
"""Wavelengths by which transfer functions are known over a band."""


@dataclass(frozen=True, eq=False)
class Measure:
    """Light by wavelength: points in metres, and electrons of each channel and part there,
    (channels, parts, points), relative to all of the brightest channel's."""

    x: Array
    of: Array

    @property
    def empty(self) -> bool:
        return not self.of.size or not self.of.any()

    @cached_property
    def nodes(self) -> Array:
        """Chebyshev points of the range, metres: what is smooth over it is known by them."""
        turns = np.pi * (np.arange(_NODES) + 0.5) / _NODES
        low, high = self.x.min(), self.x.max()
        return np.asarray((low + high) / 2 - (high - low) / 2 * np.cos(turns))

    def wrong(self, count: int) -> Array:
        """By how much the nodes' weights that integrate whatever is smooth, as the points do,
        differ from those of `count` of the picture's own nodes, relative to the brightest channel
        of each part, (channels, parts, nodes)."""
        return _wrong(self.x.tobytes(), self.of.tobytes(), self.of.shape, count)


@lru_cache(maxsize=256)
def _wrong(x: bytes, of: bytes, shape: tuple[int, ...], count: int) -> Array:
    """By value: light and filter are the same for all patterns."""
    one = Measure(np.frombuffer(x), np.frombuffer(of).reshape(shape))
    nodes = one.nodes.tolist()
    found, weights = interpolating(one.x, one.of, count)
    masses = one.of.sum(-1).max(0)
    masses = np.where(masses > 0, masses, 1.0)[None, :, None]
    apart = weights @ place_weights(nodes, found).T - _true(x, of, shape)
    return np.asarray(apart / masses)


@lru_cache(maxsize=16)
def _true(x: bytes, of: bytes, shape: tuple[int, ...]) -> Array:
    one = Measure(np.frombuffer(x), np.frombuffer(of).reshape(shape))
    return np.asarray(one.of @ place_weights(one.nodes.tolist(), one.x).T)


@lru_cache(maxsize=16)
def measure(s: Situation, which: Literal["band", "leak"]) -> Measure:
    parts = [part for layer in s.target.for_camera(s.camera).layers for part in layer.parts]
    sensor = s.camera.sensor
    curves = [sensor.spectral_efficiency or Spectrum.even(sensor.quantum_efficiency)]
    if sensor.colour is not None:
        curves = [sensor.colour.efficiencies[name] for name in sensor.colour.channels]
        curves.append(mean_curve(sensor.colour))
    ends = s.band.support if which == "band" else s.band.leak_range
    low, high = seen_range(parts, curves, *ends)
    if low >= high:
        return Measure(np.zeros(1), np.zeros((1, 1, 1)))
    x, w = fine_points(parts, curves, low, high)
    passed = s.band.transmission(x) if which == "band" else np.full_like(x, s.band.leak)
    return Measure(x, density(parts, curves, x) * (w * passed))
