"""A tunable filter and a filter wheel of the virtual bench."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, Self, get_args

from drivers.interfaces import Setting, Surroundings
from drivers.wheel import SlottedFilter, parse_slots
from optics.light.bands import Band
from optics.validation import require_positive
from simulator.devices.base import SimulatedDevice, require_duration

Range = tuple[float, float]

Shape = Literal["gaussian", "lyot", "interference"]
"""Shapes of the filter bands that a centre and a width describe."""

VISIBLE: Range = (400.0, 720.0)
"""Shortest and longest wavelength, in nanometres, at which a filter leaks; its blocking glass stops
all light beyond."""


def _require_band(shape: Shape, leak_range_nm: Range) -> Range:
    """Return the range of a filter's leak in metres.

    Raises ValueError, which names the filter's option, for an impossible shape or range.
    """
    if shape not in get_args(Shape):
        raise ValueError(f"shape is {shape!r}; choose {', '.join(get_args(Shape))}")
    low, high = leak_range_nm
    if not 0 < low < high:
        raise ValueError(f"leak_range_nm is {leak_range_nm}; give the shorter wavelength first")
    return low * 1e-9, high * 1e-9


class SimulatedFilter(SimulatedDevice):
    """Simulate a liquid-crystal tunable filter.

    Parameters
    ----------
    surroundings : Surroundings
        The bench's clock and its virtual world.
    range_nm : tuple of float, default (420.0, 720.0)
        Shortest and longest wavelength in nanometres.
    bandwidth_nm : float, default 7.0
        Full width at half maximum in nanometres, positive.
    settling_ms : float, default 50.0
        Time until a new wavelength stands, in milliseconds.
    shape : {"gaussian", "lyot", "interference"}, default "gaussian"
        Shape of the band's transmission; see `optics.light.bands.Band`.
    leak : float, default 0.0
        Share of the light that passes at all wavelengths of `leak_range_nm`, beside the band.
    leak_range_nm : tuple of float, default (400.0, 720.0)
        Shortest and longest wavelength of the leak in nanometres.
    effective_index : float, default math.inf
        Of thin films, 1 or more; see `optics.light.bands.Band`. By default, the band doesn't shift.

    Raises
    ------
    ValueError
        For an option that is out of range.
    DeviceError
        If the bench has no virtual world.
    """

    model = "simulated tunable filter"
    role = "filter"

    def __init__(
        self,
        surroundings: Surroundings,
        range_nm: tuple[float, float] = (420.0, 720.0),
        bandwidth_nm: float = 7.0,
        settling_ms: float = 50.0,
        shape: Shape = "gaussian",
        leak: float = 0.0,
        leak_range_nm: Range = VISIBLE,
        effective_index: float = math.inf,
    ) -> None:
        super().__init__(surroundings)
        if not 0 < range_nm[0] < range_nm[1]:
            raise ValueError(f"range_nm is {range_nm}; give a lowest and a higher wavelength")
        require_positive("bandwidth_nm", bandwidth_nm, "nm")
        require_duration("settling_ms", settling_ms)
        low, high = self.wavelength_range = (range_nm[0] * 1e-9, range_nm[1] * 1e-9)
        self.settling = settling_ms * 1e-3
        # A band that is valid at the shortest wavelength is valid at all others.
        leaks = _require_band(shape, leak_range_nm)
        width = bandwidth_nm * 1e-9
        band = Band(low, width, shape, leak, leaks, effective_index=effective_index)
        self._world.band = replace(band, centre=min(max(self._world.wavelength, low), high))

    @property
    def bandwidth(self) -> float:
        """Return the full width at half maximum of the band in metres."""
        return self._world.bandwidth

    @property
    def wavelength(self) -> float:
        """Return the centre of the band in metres."""
        return self._world.wavelength

    def set_wavelength(self, wavelength: float) -> Setting[float]:
        """Tune to a wavelength in metres.

        Raises DeviceError if the wavelength is out of range.
        """
        low, high = self.wavelength_range
        command = f"tune to {wavelength * 1e9:.1f} nm"
        self._faults.begin(command, self.reply_time)
        if not low <= wavelength <= high:
            reply = f"out of range, {low * 1e9:.0f} to {high * 1e9:.0f} nm"
            raise self._refuse(command, reply, "Choose a wavelength in the range")
        # A VariSpec resolves 0.01 nm. The value is rounded to a multiple of that, which files keep
        # exactly.
        actual = round(wavelength * 1e11) / 1e11
        self._world.wavelength = actual
        return Setting(wavelength, actual, self._clock.now() + self.settling)

    def make_safe(self) -> None:
        """Tune to the shortest wavelength, the safe state."""
        self.set_wavelength(self.wavelength_range[0])


class SimulatedWheel(SlottedFilter, SimulatedDevice):
    """Simulate a wheel of fixed filters.

    Parameters
    ----------
    surroundings : Surroundings
        The bench's clock and its virtual world.
    slots_nm : Sequence of tuple of float, optional
        Centre and full width at half maximum of each slot's filter, in nanometres.
    step_ms : float, default 200.0
        Milliseconds from a slot to the next; the wheel turns the shorter way.
    shape, leak, leak_range_nm, effective_index : optional
        See `SimulatedFilter`.

    Raises
    ------
    ValueError
        For an option that is out of range.
    DeviceError
        If the bench has no virtual world.
    """

    model = "simulated filter wheel"
    role = "filter"

    def __init__(
        self,
        surroundings: Surroundings,
        slots_nm: Sequence[tuple[float, float]] = ((450, 10), (532, 10), (550, 10), (633, 10)),
        step_ms: float = 200.0,
        shape: Shape = "gaussian",
        leak: float = 0.0,
        leak_range_nm: Range = VISIBLE,
        effective_index: float = math.inf,
    ) -> None:
        super().__init__(surroundings)
        require_duration("step_ms", step_ms)
        self._slots = parse_slots(slots_nm)
        leaks, index = _require_band(shape, leak_range_nm), effective_index
        self._bands = [
            Band(slot.wavelength, slot.bandwidth, shape, leak, leaks, effective_index=index)
            for slot in self._slots
        ]
        self._step = step_ms * 1e-3
        self.settling = self._step * (len(self._slots) // 2)
        self._slot = 1

    def __enter__(self) -> Self:
        super().__enter__()
        self._turn_to(1)
        return self

    @property
    def slot(self) -> int:
        """Return the number of the slot in the light, from 1."""
        return self._slot

    def set_slot(self, number: int) -> Setting[int]:
        """Turn to a slot; raise DeviceError if there is no such slot."""
        command = f"turn to slot {number}"
        self._faults.begin(command, self.reply_time)
        self._require_slot(number, command)
        around = abs(number - self._slot)
        steps = min(around, len(self._slots) - around)
        self._turn_to(number)
        return Setting(number, number, self._clock.now() + steps * self._step)

    def _turn_to(self, number: int) -> None:
        """Turn to a slot at once, and set the virtual world's band."""
        self._slot = number
        self._world.band = self._bands[number - 1]
