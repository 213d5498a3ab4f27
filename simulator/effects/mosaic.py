"""A colour filter array: neighbouring pixels see other wavelengths."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from optics.camera import Camera
from optics.light.spectrum import Spectrum
from optics.sensor import Mosaic
from simulator.effects.electron_bounds import (
    light_norm_bound,
    pixel_count,
    proportional_error_bound,
)
from simulator.effects.result_cache import cached_per_situation
from simulator.planning import Bound, OnOffEffect
from simulator.probing.picture_probe import electron_rates
from simulator.situation import Situation


class ColourFilters(OnOffEffect):
    name = "colour filter array"
    recipe_field = "mosaic"
    physics = "each pixel has one of a few colour filters, and counts the photons that it passes"
    source = "Bayer, US patent 3,971,065"

    def is_present(self, s: Situation) -> bool:
        return s.camera.sensor.colour is not None and not s.picture_probe.is_dark

    def estimated_error_if_omitted(self, s: Situation) -> float:
        return _difference(s)

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        how = "proved: Young; the largest difference of a filter's electrons from the mean pixel's"
        return proportional_error_bound(s, _difference(s) * light_norm_bound(s), how)

    def added_operations(self, s: Situation, levels: Mapping[str, int]) -> float:
        colour = s.camera.sensor.colour
        if colour is None or not levels[self.name]:
            return 0.0
        return float(pixel_count(s) * len(colour.channels))

    def explain(self, s: Situation) -> str:
        return f"in this light a pixel's electrons differ by {_difference(s):.2g} of the most"


@cached_per_situation
def _difference(s: Situation) -> float:
    """Return a filter's largest difference from the mean pixel, over the best channel's electrons.

    The maximum is over all parts and filters.
    """
    differing, largest = list(_cameras_of_differences(s)), 0.0
    lights = {(part.spectrum, one.distance) for one in s.target.layers for part in one.parts}
    for spectrum, distance in lights:
        best = max(electron_rates(spectrum, s.band, s.camera, distance))
        for camera in differing if best else ():
            # The difference is interpolated between the curves' nodes: 0.1 % is added for what
            # that may miss.
            rate = electron_rates(spectrum, s.band, camera, distance)[0]
            largest = max(largest, 1.001 * rate / best)
    return largest


def _cameras_of_differences(s: Situation) -> Iterator[Camera]:
    """Yield cameras without colour filters that see a filter's difference from the mean pixel."""
    for difference in _curve_differences(s):
        sensor = replace(s.camera.sensor, colour=None, spectral_efficiency=difference)
        yield replace(s.camera, sensor=sensor)


def _curve_differences(s: Situation) -> Iterator[Spectrum]:
    """Yield each filter's absolute difference from the mean pixel's curve."""
    colour = s.camera.sensor.colour
    if colour is None:
        return
    letters = "".join(colour.pattern)
    curves = {name: colour.efficiencies[name] for name in colour.channels}
    nodes = _nodes(colour)
    mean = sum(
        (curve.at(nodes) * (letters.count(name) / len(letters)) for name, curve in curves.items()),
        start=np.zeros_like(nodes),
    )
    for curve in curves.values():
        yield Spectrum(tuple(nodes), tuple(np.abs(curve.at(nodes) - mean)))


def _nodes(colour: Mosaic) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return the wavelengths at which any curve bends or ends, both sides of the ends included."""
    ends = [edge for one in colour.efficiencies.values() for edge in (one.low, one.high)]
    beside = [edge * (1 + side * 1e-9) for edge in ends for side in (-1, 1)]
    inner = [node for one in colour.efficiencies.values() for node in one.wavelengths]
    fine = np.linspace(min(ends), max(ends), 401)
    return np.unique(np.concatenate([inner, beside, fine]))
