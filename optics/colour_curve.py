"""Curves over the wavelength: what a lens' glass does to focus and scale of its image."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np

from optics.validation import require_wavelength

ColourCurve = Sequence[tuple[float, float]]
"""Pairs (wavelength in metres, value) of rising wavelengths. Values between two are interpolated
linearly; beyond the ends the curve goes on as straight as between its last two pairs."""


def require_colour_curve(name: str, curve: ColourCurve, most: float, unit: str) -> None:
    """Raise ValueError unless a curve is empty, or has wavelengths that rise and finite values.

    most: largest size of a value. unit: of the values, for the message.
    """
    if not curve:
        return
    if len(curve) < 2:
        raise ValueError(
            f"{name} is {list(curve)}; give two pairs or more, [wavelength, value], or none"
        )
    for wavelength, value in curve:
        require_wavelength(f"a wavelength of {name}", wavelength)
        if not math.isfinite(value) or abs(value) > most:
            raise ValueError(
                f"{name} is {value:g}{unit} at {wavelength * 1e9:g} nm; it is between "
                f"{-most:g} and {most:g}{unit}"
            )
    for (low, _), (high, _) in itertools.pairwise(curve):
        if not low < high:
            raise ValueError(
                f"{name} has {high * 1e9:g} nm after {low * 1e9:g} nm; wavelengths rise"
            )


def colour_curve_at(curve: ColourCurve, wavelength: float) -> float:
    """Return a curve's value at a wavelength in metres; 0 for an empty curve."""
    if not curve:
        return 0.0
    x, y = np.array(curve).T
    first = int(np.clip(np.searchsorted(x, wavelength) - 1, 0, len(x) - 2))
    slope = (y[first + 1] - y[first]) / (x[first + 1] - x[first])
    return float(y[first] + slope * (wavelength - x[first]))


def colour_curve_range(curve: ColourCurve, low: float, high: float) -> tuple[float, float]:
    """Return the least and the largest value of a curve between two wavelengths in metres."""
    inside = [value for wavelength, value in curve if low < wavelength < high]
    values = [*inside, colour_curve_at(curve, low), colour_curve_at(curve, high)]
    return min(values), max(values)
