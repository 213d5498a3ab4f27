"""Number formats of a CS-2000's replies, by chapter 5 of its communication specifications."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from simulator.machines.colorimetry import (
    chromaticity,
    colour_temperature,
    dominant_wavelength,
    tristimulus,
    uniform_chromaticity,
)

_FAILED_VALUE = "D1BA43B6"
"""Hexadecimal reply for a value that can't be computed."""

_NAMES_2_DEGREES = ("X", "Y", "Z", "x", "y", "u'", "v'", "T", "duv", "ld", "Pe")
_NAMES_10_DEGREES = (
    "X10",
    "Y10",
    "Z10",
    "x10",
    "y10",
    "u10'",
    "v10'",
    "T10",
    "duv10",
    "ld10",
    "Pe10",
)

BLOCKS: dict[int, tuple[str, ...]] = {
    0: ("Le", "Lv", *_NAMES_2_DEGREES, *_NAMES_10_DEGREES),
    1: ("X", "Y", "Z"),
    2: ("x", "y", "Lv"),
    3: ("u'", "v'", "Lv"),
    4: ("T", "duv", "Lv"),
    5: ("ld", "Pe", "Lv"),
    11: ("X10", "Y10", "Z10"),
    12: ("x10", "y10", "Lv"),
    13: ("u10'", "v10'", "Lv"),
    14: ("T10", "duv10", "Lv"),
    15: ("ld10", "Pe10", "Lv"),
    100: ("Le",),
    101: ("Lv",),
}
"""Names of the colorimetric values in each block of data."""


def colorimetric_values(
    wavelengths_m: NDArray[np.float64], per_nm: NDArray[np.float64]
) -> dict[str, float]:
    """Return the simulated CS-2000's colorimetric values by name; NaN where one can't be computed.

    per_nm: radiance in W/(sr m² nm).
    """
    step = float(wavelengths_m[1] - wavelengths_m[0])
    values = {"Le": float(per_nm.sum()) * step * 1e9}
    for observer, names in ((2, _NAMES_2_DEGREES), (10, _NAMES_10_DEGREES)):
        xyz = tristimulus(wavelengths_m, per_nm * 1e9, observer)
        numbers = (
            *xyz,
            *chromaticity(xyz),
            *uniform_chromaticity(xyz),
            *colour_temperature(wavelengths_m, xyz, observer),
            *dominant_wavelength(wavelengths_m, xyz, observer),
        )
        values |= dict(zip(names, map(float, numbers), strict=True))
    values["Lv"] = values["Y"]
    return values


def format_value(name: str, value: float, hexadecimal: bool, failed_is_zero: bool = False) -> str:
    """Format a value in the simulated CS-2000's reply, as the real instrument does.

    name: of a colorimetric value, or "spectral". failed_is_zero: whether a value that can't be
    computed is sent as 0, as old firmware does.
    """
    if math.isnan(value) and failed_is_zero:
        value = 0.0
    if hexadecimal:
        return _FAILED_VALUE if math.isnan(value) else struct.pack(">f", value).hex().upper()
    kind = name.removesuffix("'").removesuffix("10")
    if kind in ("x", "y", "u", "v"):
        return "-9.999" if math.isnan(value) else f"{value:.4f}"
    if kind == "T":
        return "-9999" if math.isnan(value) else f"{min(value, 99999):.0f}"
    if kind == "duv":
        return "-9.9999" if math.isnan(value) else f"{value:+.4f}"
    if kind in ("Lv", "ld", "Pe"):
        return "-9.9e9" if math.isnan(value) else _format_six_characters(value)
    return "-9.9999e9" if math.isnan(value) else _format_exponential(value)


def format_block(names: Sequence[str], values: dict[str, float], *how: bool) -> list[str]:
    return [format_value(name, values[name], *how) for name in names]


def _format_exponential(value: float) -> str:
    """Format a number of the simulated CS-2000 with four decimals and a one-digit exponent."""
    exponent = math.floor(math.log10(abs(value))) if value else -9
    exponent = max(-9, min(9, exponent))
    mantissa = f"{value / 10.0**exponent:.4f}"
    if mantissa.lstrip("-").startswith("10") and exponent < 9:
        exponent += 1
        mantissa = f"{value / 10.0**exponent:.4f}"
    return f"{mantissa}e{exponent:+d}"


def _format_six_characters(value: float) -> str:
    """Format a number of the simulated CS-2000 in six characters, with as many decimals as fit."""
    if value > 999_999.5:
        mantissa, _, exponent = f"{value:.2e}".partition("e")
        return f"{mantissa}e+{int(exponent)}"
    whole = len(f"{value:.0f}")
    return f"{value:6.{max(0, min(4, 5 - whole))}f}"
