"""What a prism does: a dot whose place follows the wavelength (thesis Figs. 4.2 and 4.11)."""

from __future__ import annotations

import math
from collections.abc import Sequence

from optics.targets.dots import Position, dots
from optics.targets.target import Drawings, Target
from optics.validation import require_positive


def dispersed_positions(
    wavelengths: Sequence[float], reference: float, rate: float, direction: float = 0.0
) -> list[Position]:
    """Where a prism sends each wavelength; all of them together are a row of dots.

    wavelengths: metres; light of the reference wavelength stays on the axis. rate: metres on the
    sensor per metre of wavelength, 1000 for a micrometre a nanometre. direction: radians from x
    towards y, in which longer waves go.
    """
    if not wavelengths:
        raise ValueError("wavelengths is empty; give one at least")
    for wavelength in (*wavelengths, reference):
        require_positive("wavelength", wavelength, "m")
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
    """The dot of every wavelength, (wavelengths, rows, columns), each with sum one.

    width: standard deviation of a dot, metres. The rest: see dispersed_positions().
    """
    places = dispersed_positions(wavelengths, reference, rate, direction)
    return Drawings([dots.draw([place], width) for place in places])
