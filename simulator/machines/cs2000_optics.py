"""The light that falls into a CS-2000, and what it needs to measure it.

The limits are those of the instrument's data sheet.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from simulator.machines.colorimetry import tristimulus

Array = NDArray[np.float64]

WAVELENGTHS: Array = np.arange(380, 781).astype(np.float64) * 1e-9
"""At which it measures, in metres."""

_SATURATION = 2.5
"""Luminance times integration time, cd s/m², that fills the sensor at 1 degree: the 5000 cd/m²
of the data sheet, in the shortest time, through the internal filter."""

_ND_TRANSMITTANCE = 0.1
"""What the internal filter passes; the instrument doesn't tell, and this is assumed."""

_RELATIVE_AREAS = (1.0, 0.04, 0.01)
"""Of the field at 1, 0.2 and 0.1 degrees, relative to the first."""


_SAMPLES_PER_NM = 5
"""Samples of the light in a nanometre, within the slit."""


class CS2000Optics:
    """From the spectrum before the lens to the sensor.

    spectrum, slit_nm, angle: as of CS2000Machine.
    """

    def __init__(self, spectrum: Callable[[Array], Array], slit_nm: int, angle: int) -> None:
        self._spectrum, self._slit = spectrum, slit_nm
        self.angle = angle
        self.attached_nd = 0
        """The external filter that is really there: 0 none, 1 a tenth, 2 a hundredth."""

    def measured_spectrum(self) -> Array:
        """Radiance through the slit and the external filter, in W/(sr m² nm)."""
        reach = _SAMPLES_PER_NM * self._slit
        nm = (
            np.arange(_SAMPLES_PER_NM * 380 - reach, _SAMPLES_PER_NM * 780 + reach + 1)
            / _SAMPLES_PER_NM
        )
        light = np.asarray(self._spectrum(nm * 1e-9), np.float64) * 1e-9
        if reach:
            weights = reach - np.abs(np.arange(-reach, reach + 1.0))
            light = np.convolve(light, weights / weights.sum(), mode="valid")
        return light[::_SAMPLES_PER_NM] * 10.0**-self.attached_nd

    def _signal(self, integration: float, nd: int) -> float:
        """What falls onto the sensor, in cd s/m² at 1 degree."""
        luminance = float(tristimulus(WAVELENGTHS, self.measured_spectrum() * 1e9)[1])
        return (
            luminance
            * integration
            * (_ND_TRANSMITTANCE if nd else 1.0)
            * _RELATIVE_AREAS[self.angle]
        )

    def is_too_bright(self, integration: float, nd: int) -> bool:
        return self._signal(integration, nd) > 1.001 * _SATURATION

    def required_exposure(self, mode: int, given: int, nd: int) -> tuple[float, int]:
        """Integration time in seconds and the internal filter, as its mode has them."""
        if mode == 3:
            return given * 1e-6, nd
        if nd == 2:
            nd = int(self._signal(0.005, 0) > _SATURATION)
        longest = {0: 120.0, 1: 16.0}.get(mode, float(given))
        bright = self._signal(1.0, nd)
        fitting = 0.8 * _SATURATION / bright if bright > 0 else math.inf
        return float(np.clip(fitting, 0.005, longest)), nd
