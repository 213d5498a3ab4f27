"""A spectroradiometer that measures the virtual bench's target through the filter."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import Spectrum, Surroundings
from simulator.devices.base import SimulatedDevice
from simulator.machines.cs2000_settings import WAVELENGTHS, CS2000Optics

_ANGLE = math.radians(1)  # the instrument's measuring angle in radians


class SimulatedSpectroradiometer(SimulatedDevice):
    """Simulate a CS-2000 spectroradiometer without its serial protocol.

    It measures a white part of the target from 380 to 780 nm.

    Parameters
    ----------
    surroundings : Surroundings
        The bench's clock and its virtual world.
    slit_nm : int, default 5
        Full width at half maximum of its triangular slit function in nanometres, from 0 (none)
        to 20.

    Raises
    ------
    ValueError
        If the slit isn't a whole number from 0 to 20.
    DeviceError
        If the bench has no virtual world.
    """

    model = "simulated spectroradiometer"
    role = "spectroradiometer"

    def __init__(self, surroundings: Surroundings, slit_nm: int = 5) -> None:
        super().__init__(surroundings)
        if not (isinstance(slit_nm, int) and 0 <= slit_nm <= 20):
            raise ValueError(f"slit_nm is {slit_nm}; it must be a whole number from 0 to 20")
        self._optics = CS2000Optics(self._world.radiance, slit_nm, 0)

    @property
    def wavelengths(self) -> NDArray[np.float64]:
        """Return the wavelengths in metres of a measured spectrum."""
        return WAVELENGTHS.copy()

    def measure(self, cancelled: Callable[[], bool]) -> Spectrum:
        """Measure the target's spectrum once.

        The integration takes 5 ms to 120 s of the bench's time; dim light takes longer. Raises
        DeviceError if the light is too bright, or if the measurement was cancelled.
        """
        self._faults.begin("measure", self.reply_time)
        began = self._clock.now()
        integration, nd = self._optics.required_exposure(0, 0, 2)
        if self._optics.is_too_bright(integration, nd):
            raise self._refuse("measure", "the light is too bright", "Dim the lamp")
        self._clock.wait_until(began + integration, lambda: cancelled() or self._faults.is_killed)
        self._faults.require_alive("measure")
        if cancelled():
            raise self._refuse("measure", "it was cancelled", "Measure again")
        radiance = self._optics.measured_spectrum() * 1e9
        return Spectrum(self.wavelengths, radiance, integration, bool(nd), _ANGLE, began)
