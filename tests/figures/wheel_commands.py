"""What every filter wheel behind a wire is asked, and the truth about it: its `position`."""

from __future__ import annotations

from typing import Any

from figures.wire_case import Command, Rng


def slots_nm(count: int) -> list[list[float]]:
    """Centre and width of slots, no two alike."""
    return [[_centre_nm(slot), _width_nm(slot)] for slot in range(1, count + 1)]


def _centre_nm(slot: int) -> int:
    return 400 + 20 * slot


def _width_nm(slot: int) -> int:
    return 5 + slot


def _turn(device: Any, rng: Rng) -> Any:
    return device.set_slot(int(rng.integers(1, len(device.slots) + 1)))


def _turn_by_wavelength(device: Any, rng: Rng) -> Any:
    return device.set_wavelength(device.slots[int(rng.integers(len(device.slots)))].wavelength)


def _stands(setting: Any, wheel: Any) -> bool:
    return setting.request == setting.actual == wheel.position


def _is_near(wavelength: float, wheel: Any) -> bool:
    return abs(wavelength - _centre_nm(wheel.position) / 1e9) < 1e-12


WHEEL = {
    "set_slot": Command(_turn, _stands),
    "set_wavelength": Command(
        _turn_by_wavelength,
        lambda told, w: told.request == told.actual and _is_near(told.actual, w),
    ),
    "slot": Command(lambda d, rng: d.slot, lambda told, w: told == w.position),
    "wavelength": Command(lambda d, rng: d.wavelength, _is_near),
    "bandwidth": Command(
        lambda d, rng: d.bandwidth, lambda told, w: round(told * 1e9) == _width_nm(w.position)
    ),
    "make_safe": Command(lambda d, rng: d.make_safe(), lambda told, w: w.position == 1),
}
