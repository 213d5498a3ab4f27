"""Compute the rate of electrons on the sensor for a spectrum of light behind a filter."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import constants

from optics.camera import Camera, Sensor
from optics.camera.pupil import open_area
from optics.light.bands import Band
from optics.light.spectrum import Spectrum


def efficiencies(sensor: Sensor) -> tuple[Spectrum | None, ...]:
    """Return the sensor's electrons per photon for the picture probe, for each colour channel.

    Each is a function of wavelength.

    None stands for the same efficiency at all wavelengths.
    """
    if sensor.colour is not None:
        return tuple(sensor.colour.efficiencies[name] for name in sensor.colour.channels)
    return (sensor.spectral_efficiency,)


def electron_rates(
    spectrum: Spectrum, band: Band, camera: Camera, distance: float, *, leak: bool = True
) -> tuple[float, ...]:
    """Return the electrons per second and square metre of sensor that a probed spectrum frees.

    There is one rate for each colour channel.

    The rate is that near the axis, by the camera equation of
    optics.camera.system_mtf.electron_rate(), integrated over wavelengths. spectrum: radiance,
    W / (sr m² m). distance: metres to the panel. leak: whether light that the filter passes outside
    its band is included.
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
    """Return the sensor's irradiance near the axis over a probed scene's radiance, sr."""
    spread = 1 + camera.separation / distance
    gathered = open_area(camera) * spread**2 / camera.lens.image_distance**2
    return gathered * camera.panel.reflectivity * camera.transmission


def _efficiency(
    curve: Spectrum | None, nodes: NDArray[np.float64], sensor: Sensor
) -> NDArray[np.float64]:
    """Return a sensor's electrons per photon at given wavelengths, for the picture probe."""
    if curve is None:
        return np.full_like(nodes, sensor.quantum_efficiency)
    return curve.at(nodes)


def _nodes(spectrum: Spectrum, band: Band, sensor: Sensor, leak: bool) -> NDArray[np.float64]:
    """Return the wavelengths at which the picture probe integrates a spectrum behind a filter.

    These are the nodes of all curves, both sides of every jump, and a fine grid over the band and
    its leak.
    """
    ranges = [band.support, *([band.leak_range] if leak and band.leak else [])]
    curves = [one for one in (spectrum, band.table, *efficiencies(sensor)) if one is not None]
    jumps = np.array([*(end for one in ranges for end in one), *(
        end for one in curves for end in (one.low, one.high)
    )])  # fmt: skip
    # With 1001 wavelengths, the integral over a smooth band is within 1e-6.
    fine = [np.linspace(*one, 1001) for one in ranges]
    bends = [np.asarray(one.wavelengths) for one in curves]
    beside = [jumps * (1 - 1e-12), jumps * (1 + 1e-12)]
    return np.unique(np.concatenate([*fine, *bends, *beside]))
