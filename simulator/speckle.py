"""Speckle of a situation: its variance, and the pattern that stays with the scene."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
import torch

from optics.sensor.moments import moments
from optics.speckle import SpeckleGrain, draw_speckle, spectral_variance
from optics.validation import as_number
from simulator.formation.nodes import channel_efficiencies, electrons_by_wavelength
from simulator.recipe import Recipe
from simulator.situation import Situation

# Cells of the panel along each axis, at most, and samples of speckle along a pixel. Chosen: with
# more samples a pixel shares few grains with its neighbours.
_PUPIL_CELLS, _MOST_SAMPLES = 96, 4


def speckle_variance(s: Situation) -> float:
    """Return the variance on each pixel over the mean squared, 0 without speckle.

    Places in the field and colour channels are taken to be alike.
    """
    surface = s.target.speckle
    if surface is None or s.picture_probe.is_dark:
        return 0.0
    known, causes = s.cache.results, ("speckle variance",)
    if causes not in known:
        rest = surface.surface_variance(s.camera.panel.unmodulated) * _of_spectrum(s)
        # A moving object's speckle takes a path on the sensor.
        scale = s.camera.magnification(s.target.distance) * s.exposure
        path = s.target.velocity[0] * scale, s.target.velocity[1] * scale
        known[causes] = rest * _grain(s).pixel_variance(s.camera.sensor.pitch, path)
    found: float = known[causes]
    return found


def speckle_pattern(s: Situation) -> torch.Tensor:
    """Draw the factor on each pixel's light, (rows, columns) float32, of mean 1.

    It stays the same for a scene's target, the sensor, what the panel shows and the wavelength,
    which seed it, from frame to frame and at any exposure.
    """
    sensor, grain = s.camera.sensor, _grain(s)
    causes = (
        sensor.fixed_seed, s.target.name, s.target.distance, s.target.speckle,
        s.panel_content.names, round(s.wavelength, 14), s.mount,
    )  # fmt: skip
    seed = int.from_bytes(hashlib.sha256(repr(causes).encode()).digest()[:8], "big")
    factor = draw_speckle(
        np.random.default_rng(seed), sensor.shape, sensor.pitch, grain, speckle_variance(s),
        grain.pixel_variance(sensor.pitch), _MOST_SAMPLES,
    )  # fmt: skip
    return torch.from_numpy(factor).to(torch.float32)


def moments_with_speckle(
    s: Situation, electrons: torch.Tensor, **switches: Any
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the pixels' mean and variance over all speckle patterns of one variance.

    A gamma distribution of the light is integrated at two points, exact where nothing clips.
    """
    sensor = s.camera.sensor
    mean = torch.zeros(electrons.shape, dtype=torch.float64)
    square = torch.zeros(electrons.shape, dtype=torch.float64)
    variance = speckle_variance(s)
    width, half = float(np.sqrt(variance)), float(np.sqrt(1 + variance))
    for sign in (-1, 1):
        # Gauss' rule of two points for a gamma distribution of mean 1.
        share, factor = (1 - sign * (width / half)) / 2, 1 + width * (width + sign * half)
        one, varied = moments(electrons * factor, s.exposure, sensor, **switches)
        mean += share * one
        square += share * (varied + one**2)
    return mean, (square - mean**2).clamp(min=0)


def _of_spectrum(s: Situation) -> float:
    """Return 1/M of the light's spectrum, as the sensor sees it through the filter."""
    surface = s.target.speckle
    assert surface is not None
    known = s.picture_probe.results
    causes = ("speckle spectrum", surface.roughness, s.band, s.camera.sensor)
    if causes not in known:
        curves = channel_efficiencies(s, Recipe.minimal(s))
        spectra = [part.spectrum for layer in s.target.layers for part in layer.parts]
        x, each = electrons_by_wavelength(spectra, curves, s.band, leak=False)
        weights = each.sum((0, 1)) if x.size else x
        known[causes] = spectral_variance(x, weights, surface.roughness)
    found: float = known[causes]
    return found


def _grain(s: Situation) -> SpeckleGrain:
    """Return the speckle's grain, from the light that the stop leaves on the panel."""
    # It doesn't depend on the pattern.
    known, causes = s.picture_probe.results, ("speckle grain", s.camera, s.mount, s.wavelength)
    if causes not in known:
        panel = s.camera.panel
        light = s.pattern_probe.aperture_share.to(torch.float64).numpy() ** 2
        if panel.illumination is not None:
            light = light * panel.illumination.at_pixels(panel).numpy()
        together = max(1, *(-(-n // _PUPIL_CELLS) for n in light.shape))
        light = _in_sensor_axes(s, _summed(light, together))
        lever = s.wavelength * as_number(s.camera.ray_matrix_b)
        known[causes] = SpeckleGrain(light, together * panel.pitch, lever)
    found: SpeckleGrain = known[causes]
    return found


def _summed(light: np.ndarray, count: int) -> np.ndarray:
    """Return the pupil's light on cells of several pixels of the panel."""
    rows, columns = (-(-n // count) for n in light.shape)
    whole = np.zeros((rows * count, columns * count))
    down, across = ((n * count - m) // 2 for n, m in zip((rows, columns), light.shape, strict=True))
    whole[down : down + light.shape[0], across : across + light.shape[1]] = light
    return whole.reshape(rows, count, columns, count).sum((1, 3))


def _in_sensor_axes(s: Situation, light: np.ndarray) -> np.ndarray:
    """Return the pupil's light in the axes of the sensor: the nearest cell of each."""
    if s.mount.is_aligned:
        return light
    side = int(np.ceil(np.hypot(*light.shape)))
    at = np.arange(side) - side // 2
    y, x = s.mount.to_panel_axes(*np.broadcast_arrays(at[:, None] * 1.0, at * 1.0))
    j, i = (np.round(one).astype(int) + n // 2 for one, n in zip((y, x), light.shape, strict=True))
    inside = (j >= 0) & (j < light.shape[0]) & (i >= 0) & (i < light.shape[1])
    return np.where(inside, light[j.clip(0, light.shape[0] - 1), i.clip(0, light.shape[1] - 1)], 0)
