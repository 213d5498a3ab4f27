"""From red, green and blue to reflectance by wavelength."""

from __future__ import annotations

from optics.light.spectrum import LONGEST_WAVELENGTH, SHORTEST_WAVELENGTH, Spectrum

Basis = tuple[Spectrum, Spectrum, Spectrum]
"""Reflectances of pure red, green and blue; a colour's is their sum by its linear shares."""

_BLUE, _GREEN, _RED = 450e-9, 540e-9, 610e-9
"""Wavelengths that a photograph's blue, green and red stand for."""


def primaries() -> Basis:
    """Linear between the three wavelengths that the colours stand for: no physics, but exact
    where a picture was taken at just these."""
    nodes = (SHORTEST_WAVELENGTH, _BLUE, _GREEN, _RED, LONGEST_WAVELENGTH)
    return (
        Spectrum(nodes, (0, 0, 0, 1, 1)),
        Spectrum(nodes, (0, 0, 1, 0, 0)),
        Spectrum(nodes, (1, 1, 0, 0, 0)),
    )


def basis_of(red: Spectrum, green: Spectrum, blue: Spectrum) -> Basis:
    """From a table, e.g. of Mallett and Yuksel (2019), who made one for the sRGB primaries whose
    sum is 1 and whose mixtures are smooth, between 0 and 1, and of the colour they are made for
    (doi 10.2312/sr.20191216).

    Beyond its ends each goes on as it ends. Raises ValueError where the three add up to more
    than a white surface reflects.
    """
    for nodes in (red.wavelengths, green.wavelengths, blue.wavelengths):
        total = red.at(nodes) + green.at(nodes) + blue.at(nodes)
        if total.max() > 1.001:
            raise ValueError(
                f"the basis adds up to {total.max():g} at some wavelength; white reflects 1 at most"
            )
    return (
        extend_to_silicon_range(red),
        extend_to_silicon_range(green),
        extend_to_silicon_range(blue),
    )


def extend_to_silicon_range(table: Spectrum) -> Spectrum:
    """A reflectance that goes on beyond its ends as it ends, wherever silicon sees."""
    wavelengths, values = list(table.wavelengths), list(table.values)
    if table.low > SHORTEST_WAVELENGTH:
        wavelengths, values = [SHORTEST_WAVELENGTH, *wavelengths], [values[0], *values]
    if table.high < LONGEST_WAVELENGTH:
        wavelengths, values = [*wavelengths, LONGEST_WAVELENGTH], [*values, values[-1]]
    return Spectrum(tuple(wavelengths), tuple(values))


def mix_reflectances(basis: Basis, colour: tuple[float, float, float]) -> Spectrum:
    """The reflectance of a colour, linear red, green and blue from 0 to 1."""
    if not all(0 <= part <= 1 for part in colour):
        raise ValueError(f"colour is {colour}; give three shares from 0 to 1")
    nodes = sorted({node for one in basis for node in one.wavelengths})
    values = sum(share * one.at(nodes) for share, one in zip(colour, basis, strict=True))
    return Spectrum(tuple(nodes), tuple(values))  # type: ignore[arg-type]
