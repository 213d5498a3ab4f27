"""Define spectra, quantities by wavelength, and those of light sources."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from optics.validation import require_positive, require_wavelength

# Limits in metres of what silicon detects. Spectra that aren't given by a table cover this range.
SHORTEST_WAVELENGTH, LONGEST_WAVELENGTH = 300e-9, 1100e-9


@dataclass(frozen=True)
class Spectrum:
    """A quantity by wavelength: piecewise linear between its nodes, and 0 beyond its ends.

    Parameters
    ----------
    wavelengths, values : tuple of float
        Nodes in metres, rising, at least two; and a value at each, finite and not negative, in the
        unit of the quantity: a radiance, a share.

    Raises
    ------
    ValueError
        For other numbers.

    Examples
    --------
    >>> from optics.light import Spectrum
    >>> float(Spectrum((400e-9, 600e-9), (0.0, 1.0)).at(500e-9))
    0.5
    """

    wavelengths: tuple[float, ...]
    values: tuple[float, ...]

    def __post_init__(self) -> None:
        for name in ("wavelengths", "values"):
            object.__setattr__(self, name, tuple(float(one) for one in getattr(self, name)))
        n, m = len(self.wavelengths), len(self.values)
        if n < 2 or n != m:
            raise ValueError(
                f"{n} wavelengths and {m} values are given; a spectrum needs two or more, and a "
                "value for each"
            )
        if not all(0 < one < math.inf for one in self.wavelengths):
            raise ValueError("a wavelength isn't positive and finite; give metres")
        if not all(a < b for a, b in zip(self.wavelengths, self.wavelengths[1:], strict=False)):
            raise ValueError("wavelengths don't rise; give them from the shortest to the longest")
        for end in (self.low, self.high):
            require_wavelength("a wavelength", end)
        wrong = [v for v in self.values if not 0 <= v < math.inf]
        if wrong:
            raise ValueError(f"a value is {wrong[0]:g}; values must be finite and not negative")

    @staticmethod
    def flat(
        value: float, low: float = SHORTEST_WAVELENGTH, high: float = LONGEST_WAVELENGTH
    ) -> Spectrum:
        """Make a spectrum with the same value at all wavelengths of a range in metres."""
        return Spectrum((low, high), (value, value))

    @property
    def low(self) -> float:
        """The shortest wavelength, in metres."""
        return self.wavelengths[0]

    @property
    def high(self) -> float:
        """The longest wavelength, in metres."""
        return self.wavelengths[-1]

    @property
    def peak(self) -> float:
        return max(self.values)

    def at(self, wavelengths: ArrayLike) -> NDArray[np.float64]:
        """Interpolate at wavelengths in metres; the same shape, float64."""
        asked = np.asarray(wavelengths, dtype=np.float64)
        return np.interp(asked, self.wavelengths, self.values, left=0.0, right=0.0)

    def with_scale(self, factor: float) -> Spectrum:
        """Return the spectrum with every value multiplied by a factor, 0 or more."""
        return Spectrum(self.wavelengths, tuple(factor * value for value in self.values))

    def times(self, other: Spectrum) -> Spectrum:
        """Multiply by another spectrum, such as a filter's.

        The product is exact at the nodes of both, and linear between them. Between two nodes the
        true product is a parabola, which differs by (a₂-a₁)(b₂-b₁)/4 at most. If the two ranges
        don't overlap, the product is 0.
        """
        low, high = max(self.low, other.low), min(self.high, other.high)
        if not low < high:
            return Spectrum(self.wavelengths, (0.0,) * len(self.wavelengths))
        union = np.union1d(self.wavelengths, other.wavelengths)
        nodes = union[(low <= union) & (union <= high)]
        return Spectrum(tuple(nodes), tuple(self.at(nodes) * other.at(nodes)))

    def integral(self, low: float | None = None, high: float | None = None) -> float:
        """Integrate exactly over a range of wavelengths in metres, by default the spectrum's own.

        Raises ValueError if the range runs backwards.
        """
        start = self.low if low is None else low
        end = self.high if high is None else high
        if start > end:
            raise ValueError(f"the range is {start:g} to {end:g} m; give the shorter first")
        start, end = max(start, self.low), min(end, self.high)
        if start >= end:
            return 0.0
        nodes = np.asarray(self.wavelengths)
        x = np.concatenate([[start], nodes[(start < nodes) & (nodes < end)], [end]])
        return float(np.trapezoid(self.at(x), x))


# Range in metres in which a source's peak counts as 1, and to which liquid-crystal filters can be
# set.
VISIBLE = (400e-9, 720e-9)

HALOGEN_TEMPERATURE = 3200.0  # kelvin, of a photographic lamp, for which tungsten film was balanced
_SECOND_RADIATION_CONSTANT = 0.01438776877503933  # h c / k in metre kelvin, exact in the SI of 2019


def blackbody(
    temperature: float, low: float = SHORTEST_WAVELENGTH, high: float = LONGEST_WAVELENGTH
) -> Spectrum:
    """Compute a black body's radiance by wavelength, λ⁻⁵ / (exp(c₂ / λ T) - 1) (Planck's law).

    Parameters
    ----------
    temperature : float
        Kelvin, finite, from 1000 up: a cooler body doesn't shine visibly.
    low, high : float, optional
        Shortest and longest wavelength in metres, by default 300e-9 and 1100e-9.

    Returns
    -------
    Spectrum
        Relative: 1 where it is brightest between 400 and 720 nm. Nodes are 1 nm apart at most.

    Raises
    ------
    ValueError
        For another temperature, or a range that runs backwards.
    """
    if not 1000 <= temperature < math.inf:
        raise ValueError(
            f"temperature is {temperature:g} K; a body that shines visibly has 1000 K or more"
        )
    if not 0 < low < high < math.inf:
        raise ValueError(f"the range is {low:g} to {high:g} m; give the shorter first")

    def nodes_and_light(low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
        # With nodes at most 1 nm apart, linear interpolation meets the spectrum of a black body of
        # 2000 K or more within 2e-4, from 400 nm on.
        nodes = np.linspace(low, high, max(2, math.ceil((high - low) / 1e-9) + 1))
        exponent = _SECOND_RADIATION_CONSTANT / (nodes * temperature)
        return nodes, nodes**-5.0 / np.expm1(exponent)

    nodes, light = nodes_and_light(low, high)
    return Spectrum(tuple(nodes), tuple(light / nodes_and_light(*VISIBLE)[1].max()))


def halogen(temperature: float = HALOGEN_TEMPERATURE) -> Spectrum:
    """Compute the spectrum of a tungsten-halogen lamp, modelled as a black body.

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
    """Make the spectrum of a single line: a narrow triangle around a wavelength.

    Parameters
    ----------
    wavelength, width : float
        Peak, and full width at half maximum, in metres; it should be small against a filter's.

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
    """Make a spectrum that is 1 at all wavelengths of a range.

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
    """Make the relative spectrum of a measured lamp.

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
