"""Draw the target of a prism: a dot whose position follows the wavelength.

Thesis Figs. 4.2 and 4.11.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from optics.targets.dots import Position, dots
from optics.targets.target import Drawings, Target
from optics.validation import require_wavelength


def dispersed_positions(
    wavelengths: Sequence[float], reference: float, rate: float, direction: float = 0.0
) -> list[Position]:
    """Compute where a prism sends wavelengths, as positions of a target's dots in a row.

    The row of dots lies on the sensor.

    Parameters
    ----------
    wavelengths : sequence of float
        Metres, one or more.
    reference : float
        Wavelength in metres that stays on the axis.
    rate : float
        Metres on the sensor per metre of wavelength: 1000 for a micrometre per nanometre.
    direction : float, default 0.0
        Angle in radians from x towards y, towards which longer waves move.

    Returns
    -------
    list of tuple of float
        (y, x) of each wavelength in metres.

    Raises
    ------
    ValueError
        If there is no wavelength, one isn't positive, or the rate or the direction isn't finite.

    References
    ----------
    Thesis Figs. 4.2 and 4.11.
    """
    if not wavelengths:
        raise ValueError("wavelengths is empty; give one at least")
    for wavelength in (*wavelengths, reference):
        require_wavelength("wavelength", wavelength)
    if not (math.isfinite(rate) and math.isfinite(direction)):
        raise ValueError(f"rate {rate:g} and direction {direction:g} rad must be finite")
    shifts = [rate * (wavelength - reference) for wavelength in wavelengths]
    return [(shift * math.sin(direction), shift * math.cos(direction)) for shift in shifts]


@Target
def linear_dispersion(
    wavelengths: Sequence[float],
    reference: float,
    rate: float,
    width: float,
    direction: float = 0.0,
) -> Drawings:
    """Draw a prism's target: one dot per wavelength, each in a picture of its own.

    The result is (wavelengths, rows, columns), and each picture has a sum of 1.

    Parameters
    ----------
    wavelengths : sequence of float
        Metres, one or more.
    reference : float
        Wavelength in metres that stays on the axis.
    rate : float
        Metres on the sensor per metre of wavelength.
    width : float
        Standard deviation of a dot, metres.
    direction : float, default 0.0
        Angle in radians from x towards y, towards which longer waves move.

    Returns
    -------
    Drawings
        One picture per wavelength, which `Target` puts on a plane.
    """
    places = dispersed_positions(wavelengths, reference, rate, direction)
    return Drawings([dots.draw([place], width) for place in places])
