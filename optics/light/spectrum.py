"""Define spectra: quantities by wavelength, such as a radiance or a transmission."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from optics.validation import require_wavelength

SHORTEST_WAVELENGTH, LONGEST_WAVELENGTH = 300e-9, 1100e-9
"""Limits in metres of the wavelengths that silicon detects. Spectra that aren't given by a table
cover this range."""


@dataclass(frozen=True)
class Spectrum:
    """A quantity by wavelength: piecewise linear between its nodes, and 0 beyond its ends.

    Parameters
    ----------
    wavelengths : tuple of float
        Nodes in metres, rising, at least two.
    values : tuple of float
        Value at each node, finite and not negative, in the unit of the quantity: a radiance, a
        share.

    Raises
    ------
    ValueError
        If there are fewer than two nodes, another number of values, wavelengths that don't rise or
        aren't positive and finite, or a value that is negative or not finite.

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
        """Make a light spectrum with the same value at all wavelengths of a range.

        Parameters
        ----------
        value : float
            The value.
        low, high : float, optional
            Ends of the range in metres, by default 300e-9 and 1100e-9.

        Returns
        -------
        Spectrum
            With a node at each end.
        """
        return Spectrum((low, high), (value, value))

    @property
    def low(self) -> float:
        """The shortest wavelength of the light spectrum, in metres."""
        return self.wavelengths[0]

    @property
    def high(self) -> float:
        """The longest wavelength of the light spectrum, in metres."""
        return self.wavelengths[-1]

    @property
    def peak(self) -> float:
        """The largest value of the light spectrum."""
        return max(self.values)

    def at(self, wavelengths: ArrayLike) -> NDArray[np.float64]:
        """Interpolate the light spectrum at wavelengths in metres; the same shape, float64."""
        asked = np.asarray(wavelengths, dtype=np.float64)
        return np.interp(asked, self.wavelengths, self.values, left=0.0, right=0.0)

    def with_scale(self, factor: float) -> Spectrum:
        """Return the light spectrum with every value multiplied by a factor, 0 or more."""
        return Spectrum(self.wavelengths, tuple(factor * value for value in self.values))

    def times(self, other: Spectrum) -> Spectrum:
        """Multiply a light spectrum by another spectrum, such as a filter's.

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
        """Integrate the light spectrum over wavelength, exactly.

        Parameters
        ----------
        low, high : float, optional
            Ends of the range in metres; the spectrum's own by default.

        Returns
        -------
        float
            The integral, in the values' unit times metres.

        Raises
        ------
        ValueError
            If the range runs backwards.
        """
        start = self.low if low is None else low
        end = self.high if high is None else high
        if start > end:
            raise ValueError(f"the range is {start:g} to {end:g} m; give the shorter first")
        start, end = max(start, self.low), min(end, self.high)
        if start >= end:
            return 0.0
        nodes = np.asarray(self.wavelengths)
        inner = nodes[(start < nodes) & (nodes < end)]
        x = np.concatenate([[start], inner, [end]])
        return float(np.trapezoid(self.at(x), x))
