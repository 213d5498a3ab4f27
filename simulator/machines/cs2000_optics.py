"""Optics of the simulated CS-2000: the light that it receives and the exposure that this needs.

The limits come from the instrument's data sheet.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from simulator.machines.colorimetry import tristimulus

Array = NDArray[np.float64]

WAVELENGTHS: Array = np.arange(380, 781).astype(np.float64) * 1e-9
"""Wavelengths at which a CS-2000 measures, in metres."""

_SATURATION = 2.5
"""Luminance times integration time, in cd s/m², that fills the sensor at 1 degree. It follows from
the 5000 cd/m² of the data sheet, with the shortest time and the internal filter."""


class CS2000Optics:
    """Simulate the light path of a CS-2000 from the spectrum before its lens to its sensor.

    spectrum, slit_nm, angle: as of CS2000Machine.
    """

    def __init__(self, spectrum: Callable[[Array], Array], slit_nm: int, angle: int) -> None:
        self._spectrum, self._slit = spectrum, slit_nm
        self.angle = angle
        self.attached_nd = 0
        """External filter that is really attached: 0 none, 1 passes a tenth, 2 a hundredth."""

    def measured_spectrum(self) -> Array:
        """Return the radiance that the simulated CS-2000 measures, in W/(sr m² nm).

        The light has passed the slit and the external filter.
        """
        samples_per_nm = 5
        reach = samples_per_nm * self._slit
        nm = (
            np.arange(samples_per_nm * 380 - reach, samples_per_nm * 780 + reach + 1)
            / samples_per_nm
        )
        light = np.asarray(self._spectrum(nm * 1e-9), np.float64) * 1e-9
        if reach:
            weights = reach - np.abs(np.arange(-reach, reach + 1.0))
            light = np.convolve(light, weights / weights.sum(), mode="valid")
        return light[::samples_per_nm] * 10.0**-self.attached_nd

    def _signal(self, integration: float, nd: int) -> float:
        """Return the exposure of the simulated CS-2000's sensor, in cd s/m² at 1 degree."""
        luminance = float(tristimulus(WAVELENGTHS, self.measured_spectrum() * 1e9)[1])
        # The instrument doesn't report its internal filter's transmittance; a tenth is assumed.
        transmittance = 0.1 if nd else 1.0
        # Areas of the fields of 1, 0.2 and 0.1 degrees, relative to the first.
        relative_area = (1.0, 0.04, 0.01)[self.angle]
        return luminance * integration * transmittance * relative_area

    def is_too_bright(self, integration: float, nd: int) -> bool:
        return self._signal(integration, nd) > 1.001 * _SATURATION

    def required_exposure(self, mode: int, given: int, nd: int) -> tuple[float, int]:
        """Return the simulated CS-2000's integration time (s) and internal filter by speed mode."""
        if mode == 3:
            return given * 1e-6, nd
        if nd == 2:
            nd = int(self._signal(0.005, 0) > _SATURATION)
        longest = {0: 120.0, 1: 16.0}.get(mode, float(given))
        bright = self._signal(1.0, nd)
        fitting = 0.8 * _SATURATION / bright if bright > 0 else math.inf
        return float(np.clip(fitting, 0.005, longest)), nd
