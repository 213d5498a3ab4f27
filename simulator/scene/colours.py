"""Reflectances by wavelength that stand for red, green and blue."""

from __future__ import annotations

from optics.light.spectrum import LONGEST_WAVELENGTH, SHORTEST_WAVELENGTH, Spectrum

Basis = tuple[Spectrum, Spectrum, Spectrum]
"""Reflectances of pure red, green and blue. The reflectance of a colour is their sum, weighted by
its linear red, green and blue."""


def primaries() -> Basis:
    """Return reflectance spectra of red, green and blue.

    The spectra are linear between 610, 540 and 450 nm. They don't come from physics, but they are
    exact for a picture that was taken at just these wavelengths.

    Returns
    -------
    tuple of Spectrum
        Reflectances of red, green and blue, from 0 to 1, over the range of silicon.
    """
    blue, green, red = 450e-9, 540e-9, 610e-9
    nodes = (SHORTEST_WAVELENGTH, blue, green, red, LONGEST_WAVELENGTH)
    of_red, of_green, of_blue = (0, 0, 0, 1, 1), (0, 0, 1, 0, 0), (1, 1, 0, 0, 0)
    return Spectrum(nodes, of_red), Spectrum(nodes, of_green), Spectrum(nodes, of_blue)


def basis_of(red: Spectrum, green: Spectrum, blue: Spectrum) -> Basis:
    """Make a basis from measured or published spectra of red, green and blue.

    Beyond its ends each spectrum continues with its last value.

    Parameters
    ----------
    red, green, blue : Spectrum
        Reflectances of the three primaries, 0 to 1.

    Returns
    -------
    tuple of Spectrum
        The three spectra, extended to the range of silicon.

    Raises
    ------
    ValueError
        If the three add up to more than a white surface reflects.

    References
    ----------
    Mallett and Yuksel 2019, doi 10.2312/sr.20191216, give such spectra for the sRGB primaries:
    their sum is 1, and their mixtures are smooth, between 0 and 1, and have the intended colour.
    """
    for nodes in (red.wavelengths, green.wavelengths, blue.wavelengths):
        total = red.at(nodes) + green.at(nodes) + blue.at(nodes)
        if total.max() > 1.001:
            raise ValueError(
                f"the basis adds up to {total.max():g} at some wavelength; white reflects 1 at most"
            )
    red, green, blue = map(extend_to_silicon_range, (red, green, blue))
    return red, green, blue


def extend_to_silicon_range(table: Spectrum) -> Spectrum:
    """Extend a reflectance by its end values to all wavelengths that silicon detects."""
    wavelengths, values = list(table.wavelengths), list(table.values)
    if table.low > SHORTEST_WAVELENGTH:
        wavelengths, values = [SHORTEST_WAVELENGTH, *wavelengths], [values[0], *values]
    if table.high < LONGEST_WAVELENGTH:
        wavelengths, values = [*wavelengths, LONGEST_WAVELENGTH], [*values, values[-1]]
    return Spectrum(tuple(wavelengths), tuple(values))


def mix_reflectances(basis: Basis, colour: tuple[float, float, float]) -> Spectrum:
    """Return a colour's reflectance spectrum as a mixture of the basis.

    Parameters
    ----------
    basis : tuple of Spectrum
        Reflectances of red, green and blue.
    colour : tuple of float
        Linear red, green and blue, each from 0 to 1.

    Returns
    -------
    Spectrum
        The reflectance by wavelength.

    Raises
    ------
    ValueError
        If a share is outside 0 to 1.
    """
    if not all(0 <= part <= 1 for part in colour):
        raise ValueError(f"colour is {colour}; give three shares from 0 to 1")
    nodes = sorted({node for one in basis for node in one.wavelengths})
    values = sum(share * one.at(nodes) for share, one in zip(colour, basis, strict=True))
    return Spectrum(tuple(nodes), tuple(values))  # type: ignore[arg-type]
