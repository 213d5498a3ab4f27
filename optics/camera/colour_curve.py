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

    most: largest size of a value.
    unit: of the values, for the message.
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


def colour_curve_at(name: str, curve: ColourCurve, wavelength: float, most: float) -> float:
    """Return a curve's value at a wavelength in metres; 0 for an empty curve.

    Raises ValueError where a curve that goes on beyond its ends exceeds `most` in size.
    """
    if not curve:
        return 0.0
    x, y = np.array(curve).T
    first = int(np.clip(np.searchsorted(x, wavelength) - 1, 0, len(x) - 2))
    slope = (y[first + 1] - y[first]) / (x[first + 1] - x[first])
    value = float(y[first] + slope * (wavelength - x[first]))
    if abs(value) > most * (1 + 1e-9):
        raise ValueError(
            f"{name} goes on to {value:.3g} at {wavelength * 1e9:.4g} nm, more than {most:.3g}; "
            "give its curve up to that wavelength"
        )
    return value


def wavelengths_between(curve: ColourCurve, low: float, high: float) -> list[float]:
    """Return both ends of a range in metres, and where the curve bends between them.

    The least and the largest of its values in the range are at these wavelengths.
    """
    return [low, *(one for one, _ in curve if low < one < high), high]
