"""Compute relative spectra of light sources: 1 where they are brightest from 400 to 720 nm."""

from __future__ import annotations

import math

import numpy as np

from optics.light.spectrum import LONGEST_WAVELENGTH, SHORTEST_WAVELENGTH, Spectrum
from optics.validation import require_positive, require_wavelength

VISIBLE = (400e-9, 720e-9)
"""Shortest and longest wavelength, metres, of the range in which a source's peak counts as 1.
Liquid-crystal filters can be set to wavelengths in this range."""

HALOGEN_TEMPERATURE = 3200.0
"""Colour temperature of a photographic halogen lamp in kelvin, for which tungsten film was
balanced."""

_SECOND_RADIATION_CONSTANT = 0.01438776877503933
"""Second radiation constant h c / k in metre kelvin, exact in the SI of 2019."""


def blackbody(
    temperature: float, low: float = SHORTEST_WAVELENGTH, high: float = LONGEST_WAVELENGTH
) -> Spectrum:
    """Compute the spectrum of a black-body light source: the radiance by wavelength.

    The radiance follows Planck's law, λ⁻⁵ / (exp(c₂ / λ T) - 1).

    Parameters
    ----------
    temperature : float
        Kelvin, from 1000 up: a cooler body doesn't shine visibly.
    low, high : float, optional
        Shortest and longest wavelength in metres, by default 300e-9 and 1100e-9.

    Returns
    -------
    Spectrum
        Relative: 1 where it is brightest between 400 and 720 nm. Nodes are 1 nm apart at most.

    Raises
    ------
    ValueError
        If the temperature is below 1000 K or not finite, or the range runs backwards.
    """
    if not 1000 <= temperature < math.inf:
        raise ValueError(
            f"temperature is {temperature:g} K; a body that shines visibly has 1000 K or more"
        )
    nodes = _nodes(low, high)
    peak = _planck(_nodes(*VISIBLE), temperature).max()
    return Spectrum(tuple(nodes), tuple(_planck(nodes, temperature) / peak))


def halogen(temperature: float = HALOGEN_TEMPERATURE) -> Spectrum:
    """Compute the spectrum of a tungsten-halogen light source, modelled as a black body.

    Tungsten's emissivity falls by a few per cent from 450 to 700 nm. The colour temperature, a
    little above the filament's own, accounts for that. The studio tungsten of ISO 7589 differs from
    it by 5 % in the L2 norm from 400 to 690 nm, and from 3100 K by 1 %.

    Parameters
    ----------
    temperature : float, default 3200.0
        Colour temperature in kelvin, from 1000 up.

    Returns
    -------
    Spectrum
        Relative: 1 where it is brightest between 400 and 720 nm.

    Raises
    ------
    ValueError
        If the temperature is below 1000 K or not finite.
    """
    return blackbody(temperature)


def monochromatic(wavelength: float, width: float = 1e-9) -> Spectrum:
    """Make the spectrum of a monochromatic light source: a narrow triangle around a wavelength.

    Parameters
    ----------
    wavelength : float
        Peak in metres.
    width : float, default 1e-9
        Full width at half maximum in metres; it should be small against a filter's.

    Returns
    -------
    Spectrum
        1 at the peak.

    Raises
    ------
    ValueError
        If a length isn't positive, or the width isn't less than the wavelength.
    """
    require_wavelength("wavelength", wavelength)
    require_positive("width", width, "m")
    if width >= wavelength:
        raise ValueError(f"width is {width:g} m; a line is narrower than its wavelength")
    return Spectrum((wavelength - width, wavelength, wavelength + width), (0.0, 1.0, 0.0))


def broadband(low: float = SHORTEST_WAVELENGTH, high: float = LONGEST_WAVELENGTH) -> Spectrum:
    """Make the spectrum of a broadband light source: 1 at all wavelengths of a range.

    Parameters
    ----------
    low, high : float, optional
        Shortest and longest wavelength in metres, by default 300e-9 and 1100e-9.

    Returns
    -------
    Spectrum
        With a node at each end.
    """
    return Spectrum.flat(1.0, low, high)


def lamp_from_table(table: Spectrum) -> Spectrum:
    """Make the relative light spectrum of a measured lamp.

    Parameters
    ----------
    table : Spectrum
        Radiance by wavelength, on any scale.

    Returns
    -------
    Spectrum
        Relative: 1 where it is brightest between 400 and 720 nm.

    Raises
    ------
    ValueError
        If the lamp is dark from 400 to 720 nm.
    """
    nodes = np.union1d(table.wavelengths, VISIBLE)
    visible = nodes[(nodes >= VISIBLE[0]) & (nodes <= VISIBLE[1])]
    peak = float(table.at(visible).max())
    if peak == 0:
        raise ValueError("the table is 0 from 400 to 720 nm; give a lamp that shines there")
    return table.with_scale(1 / peak)


def _nodes(low: float, high: float) -> np.ndarray:
    if not 0 < low < high < math.inf:
        raise ValueError(f"the range is {low:g} to {high:g} m; give the shorter first")
    # With nodes at most 1 nm apart, linear interpolation meets the spectrum of a black body of
    # 2000 K or more within 2e-4, from 400 nm on.
    return np.linspace(low, high, max(2, math.ceil((high - low) / 1e-9) + 1))


def _planck(wavelengths: np.ndarray, temperature: float) -> np.ndarray:
    return wavelengths**-5.0 / np.expm1(_SECOND_RADIATION_CONSTANT / (wavelengths * temperature))
