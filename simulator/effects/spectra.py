"""The light of a band by wavelength, and how well a few wavelengths stand for it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from optics.light import Spectrum
from optics.light.bands import Band
from simulator.formation.nodes import (
    electrons_by_wavelength,
    gauss_quadrature,
    interpolation_weights,
    mean_curve,
)
from simulator.situation import Situation

Array = NDArray[np.float64]

_NODES = 49
"""Wavelengths by which transfer functions are known over a band."""


@dataclass(frozen=True, eq=False)
class SpectralMeasure:
    """Light by wavelength: points in metres, and electrons of each channel and part there,
    (channels, parts, points), relative to all of the brightest channel's."""

    wavelengths: Array
    electrons: Array

    @property
    def is_empty(self) -> bool:
        return not self.electrons.size or not self.electrons.any()

    @cached_property
    def nodes(self) -> Array:
        """Chebyshev points of the range, metres: what is smooth over it is known by them."""
        turns = np.pi * (np.arange(_NODES) + 0.5) / _NODES
        low, high = self.wavelengths.min(), self.wavelengths.max()
        return np.asarray((low + high) / 2 - (high - low) / 2 * np.cos(turns))

    def weight_errors(self, count: int) -> Array:
        """By how much the nodes' weights that integrate whatever is smooth, as the points do,
        differ from those of `count` of the picture's own nodes, relative to the brightest channel
        of each part, (channels, parts, nodes)."""
        return _wrong(self, count)

    @cached_property
    def _true(self) -> Array:
        return np.asarray(
            self.electrons @ interpolation_weights(self.nodes.tolist(), self.wavelengths).T
        )


@lru_cache(maxsize=256)
def _wrong(one: SpectralMeasure, count: int) -> Array:
    found, weights = gauss_quadrature(one.wavelengths, one.electrons, count)
    masses = one.electrons.sum(-1).max(0)
    masses = np.where(masses > 0, masses, 1.0)[None, :, None]
    apart = weights @ interpolation_weights(one.nodes.tolist(), found).T - one._true
    return np.asarray(apart / masses)


def spectral_measure(s: Situation, which: Literal["band", "leak"]) -> SpectralMeasure:
    parts = [part for layer in s.target.for_camera(s.camera).layers for part in layer.parts]
    sensor = s.camera.sensor
    curves = [sensor.spectral_efficiency or Spectrum.flat(sensor.quantum_efficiency)]
    if sensor.colour is not None:
        curves = [sensor.colour.efficiencies[name] for name in sensor.colour.channels]
        curves.append(mean_curve(sensor.colour))
    spectra = tuple(part.spectrum for part in parts)
    return _measure(spectra, tuple(curves), s.band, which == "leak")


@lru_cache(maxsize=16)
def _measure(
    spectra: tuple[Spectrum, ...], curves: tuple[Spectrum, ...], band: Band, leak: bool
) -> SpectralMeasure:
    """By value: light and filter are the same for every pattern."""
    return SpectralMeasure(*electrons_by_wavelength(spectra, curves, band, leak))


def leak_share(s: Situation) -> float:
    """Electrons that light beside the band frees of any part and channel, over those of its
    brightest channel."""
    if not s.band.leak:
        return 0.0
    beside, inside = (
        spectral_measure(s, "leak").electrons.sum(-1),
        spectral_measure(s, "band").electrons.sum(-1),
    )
    both = (beside + inside).max(0)
    lit = both > 0
    return float((beside[:, lit] / both[lit]).max()) if lit.any() else 0.0
