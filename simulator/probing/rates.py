"""How many electrons a spectrum makes behind a filter."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import constants

from optics.camera import Camera, Sensor
from optics.light.bands import Band
from optics.light.spectrum import Spectrum
from optics.pupil import open_area

_NODES = 1001
"""Wavelengths across a band, and across its leak: of a smooth band within 1e-6."""


def efficiencies(sensor: Sensor) -> tuple[Spectrum | None, ...]:
    """Electrons per photon by wavelength, of each colour channel; None: the same at all."""
    if sensor.colour is not None:
        return tuple(sensor.colour.efficiencies[name] for name in sensor.colour.channels)
    return (sensor.spectral_efficiency,)


def electron_rates(
    spectrum: Spectrum, band: Band, camera: Camera, distance: float, *, leak: bool = True
) -> tuple[float, ...]:
    """Electrons per second and square metre of sensor, of each colour channel, near the axis.

    spectrum: radiance, W / (sr m² m). distance: metres to the panel. leak: with what the filter
    passes beside its band. It's the camera equation of optics.throughput.electron_rate() integrated
    over wavelengths.
    """
    nodes = _nodes(spectrum, band, camera.sensor, leak)
    passed = band.total_transmission(nodes) if leak else band.transmission(nodes)
    photons = spectrum.at(nodes) * passed * nodes / (constants.h * constants.c)
    return tuple(
        float(np.trapezoid(photons * _efficiency(one, nodes, camera.sensor), nodes))
        * irradiance_per_radiance(camera, distance)
        for one in efficiencies(camera.sensor)
    )


def irradiance_per_radiance(camera: Camera, distance: float) -> float:
    """Watts on a square metre of sensor for a radiance of one, near the axis."""
    spread = 1 + camera.separation / distance
    gathered = open_area(camera) * spread**2 / camera.lens.image_distance**2
    return gathered * camera.panel.reflectivity * camera.transmission


def _efficiency(
    curve: Spectrum | None, nodes: NDArray[np.float64], sensor: Sensor
) -> NDArray[np.float64]:
    if curve is None:
        return np.full_like(nodes, sensor.quantum_efficiency)
    return curve.at(nodes)


def _nodes(spectrum: Spectrum, band: Band, sensor: Sensor, leak: bool) -> NDArray[np.float64]:
    """All at which something bends or jumps, both sides of a jump, and enough between."""
    ranges = [band.support, *([band.leak_range] if leak and band.leak else [])]
    curves = [one for one in (spectrum, band.table, *efficiencies(sensor)) if one is not None]
    jumps = np.array([*(end for one in ranges for end in one), *(
        end for one in curves for end in (one.low, one.high)
    )])  # fmt: skip
    fine = [np.linspace(*one, _NODES) for one in ranges]
    bends = [np.asarray(one.wavelengths) for one in curves]
    beside = [jumps * (1 - 1e-12), jumps * (1 + 1e-12)]
    return np.unique(np.concatenate([*fine, *bends, *beside]))
