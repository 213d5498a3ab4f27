"""The light of a band by wavelength, and how well a few wavelengths stand for it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Literal

import numpy as np
import torch
from numpy.typing import NDArray

from optics.formation import spectrum_of_samples
from optics.light import Spectrum
from simulator.formation.nodes import (
    density,
    fine_points,
    interpolating,
    mean_curve,
    seen_range,
)
from simulator.probing.radial import RadialProfile

if TYPE_CHECKING:
    from simulator.situation import Situation

Array = NDArray[np.float64]

_TURNS = np.concatenate([[0.0], np.geomspace(1e-4, 1e4, 160)])
"""Phases, radians at the edge of the band, at which quadrature is tried."""


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
    def _true(self) -> NDArray[np.complex128]:
        """Means of exp(i turn (x - middle)), in half widths of the range, for each turn."""
        return np.asarray(
            self.of @ np.exp(1j * np.outer(self._away(self.x), _TURNS)), np.complex128
        )

    def _away(self, x: Array) -> Array:
        low, high = self.x.min(), self.x.max()
        return (x - (low + high) / 2) / max((high - low) / 2, 1e-15)

    def errors(self, count: int) -> Array:
        """How wrong `count` nodes make these means, at most of any channel, relative to the
        brightest of each part: (parts, turns), at most up to each turn."""
        nodes, weights = interpolating(self.x, self.of, count)
        found = weights @ np.exp(1j * np.outer(self._away(nodes), _TURNS))
        masses = self.of.sum(-1).max(0)
        masses = np.where(masses > 0, masses, 1.0)[None, :, None]
        wrong = (np.abs(self._true - found) / masses).max(axis=0)
        return np.maximum.accumulate(wrong, axis=-1)

    def error(self, errors: Array, shift: Array, centre: float) -> Array:
        """Of one part's, that of exp(i shift (x / centre - 1)); 2 beyond what was tried."""
        half = (self.x.max() - self.x.min()) / 2 / centre
        index = np.searchsorted(_TURNS, shift * half)
        return np.append(errors, 2.0)[index]


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


@lru_cache(maxsize=4)
def colours(s: Situation) -> list[tuple[list[int], RadialProfile]]:
    """For each different spectrum, the numbers of the parts that have it, through all layers, and
    the power by frequency of what shines with it, hidden or not."""
    target, picture = s.target.for_camera(s.camera), s.picture
    numbers: dict[Spectrum, list[int]] = {}
    lights: dict[Spectrum, torch.Tensor] = {}
    parts = [(layer, part) for layer in target.layers for part in layer.parts]
    rates = [rate for of_layer in picture.rates for rate in of_layer]
    for number, (_, part) in enumerate(parts):
        numbers.setdefault(part.spectrum, []).append(number)
    if len(numbers) <= 1:
        return [(list(range(len(parts))), picture.power)]
    for (layer, part), rate in zip(parts, rates, strict=True):
        if rate:
            scale = s.camera.magnification(layer.distance)
            light = rate * part.picture.light(picture.plane, scale, picture.shift)
            known = lights.get(part.spectrum)
            lights[part.spectrum] = light if known is None else known + light
    return [
        (numbers[spectrum], RadialProfile.of(spectrum_of_samples(light), picture.plane))
        for spectrum, light in lights.items()
    ]
