"""The band of a spectral filter: its transmission by wavelength."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from optics.light.spectrum import LONGEST_WAVELENGTH, SHORTEST_WAVELENGTH, Spectrum
from optics.validation import (
    require_choice,
    require_positive,
    require_share,
    require_size,
    require_wavelength,
)

# Exponent of an interference filter's super-Gaussian: from 90 to 10 % within a quarter of its
# width.
_STEEPNESS = 6

_Shape = Literal["gaussian", "lyot", "interference", "open", "table"]


@dataclass(frozen=True)
class Band:
    """Transmission of a filter by wavelength, 1 at its best.

    What the filter loses at its best belongs to the camera's transmission. The shapes are:

    - "gaussian".
    - "lyot": a liquid-crystal tunable filter. Stages between polarisers have retardances that
      double from each to the next, and pass cos²(π mₖ λ₀/λ) each; all are tuned to whole waves mₖ
      at λ₀, so that with u = π m (λ₀/λ - 1) the product is [sin(2ᴺu) / (2ᴺ sin u)]². Its side lobes
      end where a blocking glass keeps out the next order.
    - "interference": thin films with steep sides and a flat top, a super-Gaussian.
    - "open": no filter: everything within the width.
    - "table": `table`, scaled to 1 at its best; see `Band.from_table`.

    Parameters
    ----------
    centre, fwhm : float
        Central wavelength and full width at half maximum in metres; the width is less than twice
        the centre, and for "lyot" a quarter of it at most.
    shape : {"gaussian", "lyot", "interference", "open", "table"}, default "gaussian"
        Shape of the curve.
    leak, leak_range : float, default 0.0, tuple of float, default (400e-9, 720e-9)
        Transmission, from 0 to below 1, that is added everywhere from a shortest to a longest
        wavelength in metres.
    table : Spectrum, optional
        Measured curve, for the shape "table" only.
    effective_index : float, default math.inf
        Refractive index that stands for the layers of a thin-film filter when light passes aslant,
        1 or more; see `at_angle`. Mostly 1.5 to 2.5; infinite for a band that doesn't shift, as a
        Lyot filter's.

    Raises
    ------
    ValueError
        For another word, a number outside of its range, or a table without that shape.

    References
    ----------
    B. Lyot 1944, Ann. Astrophys. 7, 31; J. W. Evans 1949, J. Opt. Soc. Am. 39, 229,
    doi 10.1364/JOSA.39.000229. H. A. Macleod, Thin-Film Optical Filters, on tilted filters.
    """

    centre: float
    fwhm: float
    shape: _Shape = "gaussian"
    leak: float = 0.0
    leak_range: tuple[float, float] = (400e-9, 720e-9)
    table: Spectrum | None = None
    effective_index: float = math.inf

    def __post_init__(self) -> None:
        require_wavelength("centre", self.centre)
        require_positive("fwhm", self.fwhm, "m")
        require_size("bandwidth", "fwhm", self.fwhm)
        require_choice("shape", self.shape, get_args(_Shape))
        if (self.shape == "table") != (self.table is not None):
            raise ValueError("a table goes with the shape 'table', and only with it")
        # A filter that is twice as wide as its centre would reach down to negative wavelengths.
        if not self.fwhm < 2 * self.centre:
            raise ValueError(
                f"fwhm is {self.fwhm:g} m around {self.centre:g} m; give less than twice the centre"
            )
        if self.shape == "lyot" and not self.fwhm <= 0.25 * self.centre:
            raise ValueError(
                f"fwhm is {self.fwhm:g} m; a lyot filter's is a quarter of its centre, "
                f"{self.centre:g} m, at most"
            )
        if not 0 <= self.leak < 1:
            raise ValueError(f"leak is {self.leak:g}; give a share from 0 to below 1")
        low, high = self.leak_range
        if not 0 < low < high < math.inf:
            raise ValueError(f"leak_range is {low:g} to {high:g} m; give the shorter first")
        if not self.effective_index >= 1:
            raise ValueError(
                f"effective_index is {self.effective_index:g}; thin films have 1 or more, mostly "
                "1.5 to 2.5 (inf for a band that doesn't shift)"
            )
        if self.shape == "lyot" and self.shifts_with_angle:
            raise ValueError(
                f"effective_index is {self.effective_index:g}; a lyot filter has no thin films: "
                "leave it out, or choose the shape interference"
            )

    @property
    def shifts_with_angle(self) -> bool:
        """Whether the filter's band is another for light that passes aslant."""
        return math.isfinite(self.effective_index)

    def at_angle(self, squared_sine: float) -> Band:
        """Return the band that the filter has for light that passes aslant.

        The phase that a layer adds is in proportion to its thickness times the cosine of the angle
        within it, over the wavelength. So all wavelengths of the curve are multiplied by that
        cosine, √(1 - sin²θ / n²), where `squared_sine` is sin² of the angle of incidence in air, 0
        to 1. The two polarisations aren't told apart. The result has no effective index.
        """
        require_share("squared_sine", squared_sine)
        shorter = math.sqrt(1 - squared_sine / self.effective_index**2)
        table = self.table
        if table is not None:
            table = replace(table, wavelengths=tuple(shorter * one for one in table.wavelengths))
        centre, width = shorter * self.centre, shorter * self.fwhm
        return replace(self, centre=centre, fwhm=width, table=table, effective_index=math.inf)

    @staticmethod
    def from_table(
        table: Spectrum, leak: float = 0.0, leak_range: tuple[float, float] = (400e-9, 720e-9)
    ) -> Band:
        """Make the band of a measured filter from its transmission curve on any scale.

        Its centre is the mean of the wavelengths, weighted by transmission; its width lies between
        the outermost half maxima. Raises ValueError if the table passes nothing.
        """
        if table.peak == 0:
            raise ValueError("the table passes nothing; give a filter's transmission")
        one = table.with_scale(1 / table.peak)
        nodes, values = np.asarray(one.wavelengths), np.asarray(one.values)
        # Simpson's rule is exact for the first moment of a linear piece.
        middle, mean = (nodes[1:] + nodes[:-1]) / 2, (values[1:] + values[:-1]) / 2
        ends = nodes * values
        moment = float((np.diff(nodes) * (ends[1:] + ends[:-1] + 4 * middle * mean) / 6).sum())
        width = _half_width(nodes, values)
        return Band(moment / one.integral(), width, "table", leak, leak_range, one)

    def transmission(self, wavelengths: ArrayLike) -> NDArray[np.float64]:
        """Compute the transmission, 0 to 1, at wavelengths in metres, the leak left out."""
        asked = np.asarray(wavelengths, dtype=np.float64)
        if self.table is not None:
            return self.table.at(asked)
        offset = 2 * (asked - self.centre) / self.fwhm
        if self.shape == "gaussian":
            return np.exp(-math.log(2) * offset**2)
        if self.shape == "interference":
            return np.exp(-math.log(2) * np.abs(offset) ** _STEEPNESS)
        if self.shape == "open":
            return (np.abs(offset) <= 1).astype(np.float64)
        stages, order = self._stages
        low, high = self.support
        inside = (low <= asked) & (asked <= high)
        u = math.pi * order * (self.centre / np.where(inside, asked, self.centre) - 1)
        product = np.ones_like(u)
        for stage in range(stages):
            product = product * np.cos(2**stage * u) ** 2
        return np.where(inside, product, 0.0)

    def total_transmission(self, wavelengths: ArrayLike) -> NDArray[np.float64]:
        """Compute the transmission at wavelengths in metres, with the leak."""
        asked = np.asarray(wavelengths, dtype=np.float64)
        low, high = self.leak_range
        return self.transmission(asked) + self.leak * ((low <= asked) & (asked <= high))

    @cached_property
    def support(self) -> tuple[float, float]:
        """The shortest and longest wavelength in metres at which 1e-6 passes, the leak left out."""
        if self.table is not None:
            return self.table.low, self.table.high
        if self.shape == "lyot":
            _, order = self._stages
            low = self.centre / (1 + 0.5 / order)
            high = self.centre / (1 - 0.5 / order) if order > 0.5 else math.inf
            return max(SHORTEST_WAVELENGTH, low), min(LONGEST_WAVELENGTH, high)
        halvings = -math.log2(1e-6)
        reach = 1.0 if self.shape == "open" else math.sqrt(halvings)
        if self.shape == "interference":
            reach = halvings ** (1 / _STEEPNESS)
        half = 0.5 * self.fwhm * reach
        return max(self.centre - half, 0.01 * self.centre), self.centre + half

    @property
    def whole_support(self) -> tuple[float, float]:
        """The shortest and longest wavelength in metres that pass, the leak included."""
        if not self.leak:
            return self.support
        low, high = zip(self.support, self.leak_range, strict=True)
        return min(low), max(high)

    @cached_property
    def _stages(self) -> tuple[int, float]:
        """The number of stages of the Lyot model, and the order of its thinnest stage.

        The order lies between half a wave and one wave, so that the filter has the requested width,
        and its next order lies below half its wavelength.
        """
        # λ± = λ₀ / (1 ∓ a) with half maxima at u = ± π m a lie 2 a λ₀ / (1 - a²) apart.
        ratio = self.fwhm / self.centre
        a = (math.sqrt(1 + ratio**2) - 1) / ratio
        stages = 1
        while _lyot_half(stages) / (math.pi * a) > 1:
            stages += 1
        return stages, _lyot_half(stages) / (math.pi * a)


def _lyot_half(stages: int) -> float:
    """Return the phase u at which a Lyot filter of `stages` stages passes half the light."""

    def above_half(u: float) -> float:
        return math.prod(math.cos(2**k * u) ** 2 for k in range(stages)) - 0.5

    return float(brentq(above_half, 0.0, math.pi / 2**stages, xtol=1e-15))


def _half_width(nodes: NDArray[np.float64], values: NDArray[np.float64]) -> float:
    """Return the width between the outermost half maxima of a piecewise linear curve of peak 1."""
    above = np.flatnonzero(values >= 0.5)
    first, last = int(above[0]), int(above[-1])

    def crossing(inside: int, outside: int) -> float:
        if not 0 <= outside < len(nodes):
            return float(nodes[inside])
        share = (values[inside] - 0.5) / (values[inside] - values[outside])
        return float(nodes[inside] + share * (nodes[outside] - nodes[inside]))

    return crossing(last, last + 1) - crossing(first, first - 1)
