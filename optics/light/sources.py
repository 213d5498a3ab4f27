"""Spectra of light sources, relative: 1 where they are brightest between 400 and 720 nm."""

from __future__ import annotations

import math

import numpy as np

from optics.light.spectrum import LONGEST_WAVELENGTH, SHORTEST_WAVELENGTH, Spectrum
from optics.validation import require_positive

VISIBLE = (400e-9, 720e-9)
"""Metres: where a source's brightest counts as 1, and what liquid-crystal filters can be set to."""

HALOGEN_TEMPERATURE = 3200.0
"""Kelvin, of a photographic halogen lamp: what tungsten film was balanced for."""

_SECOND_CONSTANT = 0.01438776877503933
"""Metre kelvin: h c / k, exact in the SI of 2019."""

_STEP = 1e-9
"""Metres between nodes: a black body of 2000 K and more is met within 2e-4 of itself, from 400 nm
on."""


def blackbody(
    temperature: float, low: float = SHORTEST_WAVELENGTH, high: float = LONGEST_WAVELENGTH
) -> Spectrum:
    """Planck's law for the radiance by wavelength, λ⁻⁵ / (exp(c₂ / λ T) - 1).

    temperature: kelvin, from 1000 up: a cooler body doesn't shine visibly. Raises ValueError.
    """
    if not 1000 <= temperature < math.inf:
        raise ValueError(
            f"temperature is {temperature:g} K; a body that shines visibly has 1000 K or more"
        )
    nodes = _nodes(low, high)
    peak = _planck(_nodes(*VISIBLE), temperature).max()
    return Spectrum(tuple(nodes), tuple(_planck(nodes, temperature) / peak))


def halogen(temperature: float = HALOGEN_TEMPERATURE) -> Spectrum:
    """A tungsten-halogen lamp, as a black body of its colour temperature.

    Tungsten's emissivity falls by a few per cent from 450 to 700 nm, which the colour
    temperature, a little above the filament's own, has in it. The studio tungsten of ISO 7589
    differs from it by 5 % in the L2 norm from 400 to 690 nm, and from 3100 K by 1 %.
    """
    return blackbody(temperature)


def monochromatic(wavelength: float, width: float = 1e-9) -> Spectrum:
    """A line: a triangle of a full width at half maximum, in metres, small against a filter's."""
    require_positive("wavelength", wavelength, "m")
    require_positive("width", width, "m")
    if width >= wavelength:
        raise ValueError(f"width is {width:g} m; a line is narrower than its wavelength")
    return Spectrum((wavelength - width, wavelength, wavelength + width), (0.0, 1.0, 0.0))


def broadband(low: float = SHORTEST_WAVELENGTH, high: float = LONGEST_WAVELENGTH) -> Spectrum:
    """The same at all wavelengths of a range, in metres."""
    return Spectrum.flat(1.0, low, high)


def lamp_from_table(table: Spectrum) -> Spectrum:
    """A measured lamp, made relative. Raises ValueError for one that is dark in the visible."""
    nodes = np.union1d(table.wavelengths, VISIBLE)
    visible = nodes[(nodes >= VISIBLE[0]) & (nodes <= VISIBLE[1])]
    peak = float(table.at(visible).max())
    if peak == 0:
        raise ValueError("the table is 0 from 400 to 720 nm; give a lamp that shines there")
    return table.with_scale(1 / peak)


def _nodes(low: float, high: float) -> np.ndarray:
    if not 0 < low < high < math.inf:
        raise ValueError(f"the range is {low:g} to {high:g} m; give the shorter first")
    return np.linspace(low, high, max(2, math.ceil((high - low) / _STEP) + 1))


def _planck(wavelengths: np.ndarray, temperature: float) -> np.ndarray:
    return wavelengths**-5.0 / np.expm1(_SECOND_CONSTANT / (wavelengths * temperature))
