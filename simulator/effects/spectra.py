"""The light of a filter's band by wavelength, and the quadrature errors of few wavelengths."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from optics.light import Spectrum
from optics.light.bands import Band
from simulator.effects.rendering_work import LEVELS
from simulator.filter_angles import some_angles
from simulator.formation.nodes import (
    electrons_by_angle,
    gauss_quadrature,
    interpolation_weights,
    mean_curve,
)
from simulator.probing.picture_probe import PROBED_ANGLES
from simulator.situation import Situation

Array = NDArray[np.float64]
Which = Literal["band", "leak"]


@dataclass(frozen=True, eq=False)
class SpectralMeasure:
    """The electrons that light frees, by wavelength; all channels, for each angle at the filter.

    wavelengths: points in metres.
    electrons: of each channel and part at the points, relative to all of the brightest channel's,
        (channels, parts, points).
    """

    wavelengths: Array
    electrons: Array

    @property
    def is_empty(self) -> bool:
        """Whether light frees no electrons, so that band or leak changes nothing."""
        return not self.electrons.size or not self.electrons.any()

    @cached_property
    def nodes(self) -> Array:
        """Return 49 Chebyshev wavelengths, metres, between which transfer functions are smooth."""
        count = 49
        turns = np.pi * (np.arange(count) + 0.5) / count
        low, high = self.wavelengths.min(), self.wavelengths.max()
        return np.asarray((low + high) / 2 - (high - low) / 2 * np.cos(turns))

    @cached_property
    def exact_weights(self) -> Array:
        """Return the weights that integrate values at the nodes over the whole spectrum."""
        nodes = self.nodes.tolist()
        return np.asarray(self.electrons @ interpolation_weights(nodes, self.wavelengths).T)


@lru_cache(maxsize=256)
def weight_errors(one: SpectralMeasure, count: int) -> Array:
    """Return the errors of the weights if `count` Gauss nodes stand for the light.

    The weights integrate values at `nodes` over the spectrum. The errors are relative to the
    brightest channel of each part, (channels, parts, nodes).
    """
    found, weights = gauss_quadrature(one.wavelengths, one.electrons, count)
    masses = one.electrons.sum(-1).max(0)
    masses = np.where(masses > 0, masses, 1.0)[None, :, None]
    apart = weights @ interpolation_weights(one.nodes.tolist(), found).T - one.exact_weights
    return np.asarray(apart / masses)


def spectral_measure(s: Situation, which: Which) -> SpectralMeasure:
    """Return the electrons that a situation's light frees over band or leak, by wavelength."""
    spectra, curves = _lights_and_curves(s)
    angles = some_angles(s.camera, s.band, PROBED_ANGLES)
    return _measure(spectra, curves, s.band, which == "leak", tuple(angles))


def _lights_and_curves(s: Situation) -> tuple[tuple[Spectrum, ...], tuple[Spectrum, ...]]:
    """Return the spectra of a situation's parts, and the electrons per photon of its channels."""
    parts = [part for layer in s.target.layers for part in layer.parts]
    sensor = s.camera.sensor
    curves = [sensor.spectral_efficiency or Spectrum.flat(sensor.quantum_efficiency)]
    if sensor.colour is not None:
        curves = [sensor.colour.efficiencies[name] for name in sensor.colour.channels]
        curves.append(mean_curve(sensor.colour))
    return tuple(part.spectrum for part in parts), tuple(curves)


def measures_at_angles(s: Situation, squared: Sequence[Sequence[float]]) -> list[Array]:
    """Return wavelengths in metres, and the electrons at them for lists of angles' sin².

    Each array of electrons is (angles, channels, parts, wavelengths).
    """
    x, measures = electrons_by_angle(
        *_lights_and_curves(s), s.band, [one for many in squared for one in many], leak=False
    )
    ends = np.cumsum([len(many) for many in squared])[:-1]
    return [x, *np.split(measures, ends)]


@lru_cache(maxsize=16)
def _measure(
    spectra: tuple[Spectrum, ...],
    curves: tuple[Spectrum, ...],
    band: Band,
    leak: bool,
    angles: tuple[float, ...],
) -> SpectralMeasure:
    """Return the electrons by wavelength, cached by the values of light and filter."""
    x, measures = electrons_by_angle(spectra, curves, band, angles, leak=leak)
    angles_and_channels = measures.shape[0] * measures.shape[1]
    return SpectralMeasure(x, measures.reshape(angles_and_channels, *measures.shape[2:]))


def angle_shares(s: Situation) -> Array:
    """Return the least light of a part and channel by angle, over the most at any, (angles,)."""
    if not s.band.shifts_with_angle:
        return np.ones(1)
    masses = spectral_measure(s, "band").electrons.sum(-1)
    by_angle = masses.reshape(PROBED_ANGLES, -1)
    most = by_angle.max(0)
    lit = most > 0
    return np.asarray((by_angle[:, lit] / most[lit]).min(1)) if lit.any() else np.ones(1)


def leak_share(s: Situation) -> float:
    """Return the leak's largest share of a part's electrons, over those of its best channel."""
    if not s.band.leak:
        return 0.0
    beside = spectral_measure(s, "leak").electrons.sum(-1)
    inside = spectral_measure(s, "band").electrons.sum(-1)
    both = (beside + inside).max(0)
    lit = both > 0
    return float((beside[:, lit] / both[lit]).max()) if lit.any() else 0.0


def mean_change_bound(
    s: Situation, shape: tuple[int, ...], change_at: Callable[[float, Which], Array]
) -> Array:
    """Bound the mean of changes over all light in any channel of any part of the target.

    The number of wavelengths may be any.
    change_at: returns the changes at a wavelength in metres of band or leak.
    """
    band = _largest_mean(s, shape, "band", change_at)
    return np.asarray((band + _largest_mean(s, shape, "leak", change_at)).max(-1))


def _largest_mean(
    s: Situation, shape: tuple[int, ...], which: Which, change_at: Callable[[float, Which], Array]
) -> Array:
    """Return the mean changes of each channel of each part over band or leak, (..., rows).

    Each is the largest for any number of wavelengths, relative to all light of the best channel.
    """
    measures = [spectral_measure(s, "band"), spectral_measure(s, "leak")]
    found = measures[which == "leak"]
    if found.is_empty:
        return np.zeros((*shape, 1))
    masses = np.sum([one.electrons.sum(-1) for one in measures if not one.is_empty], axis=0)
    brightest = np.maximum(masses.max(0), 1e-300)
    total = np.zeros((*shape, masses.size))
    for count in LEVELS.wavelengths if which == "band" else LEVELS.leak[1:]:
        nodes, weights = gauss_quadrature(found.wavelengths, found.electrons, count)
        shares = np.abs(weights / brightest[:, None]).reshape(-1, len(nodes))
        changes = np.stack([change_at(one, which) for one in nodes.tolist()], axis=-1)
        total = np.maximum(total, changes @ shares.T)
    return total
