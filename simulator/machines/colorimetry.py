"""Colour values that a CS-2000 computes from a spectrum.

The colour matching functions are the analytic fits of Wyman, Sloan and Shirley, "Simple Analytic
Approximations to the CIE XYZ Color Matching Functions", JCGT 2(2), 2013: multi-lobe for the 2
degrees observer of 1931, single-lobe for the 10 degrees observer of 1964. They differ from the
tables by 0.7 to 1.4 % and 2.5 to 3.2 % of the tables' norm. The constants are those of CIE
015:2018.
"""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import NDArray

KM = 683.002
"""Greatest luminous efficacy, in lumens per watt."""

# Second radiation constant, in metre kelvins, with which the colour temperature is defined.
_C2 = 1.4388e-2

# Temperatures in kelvins at which the Planckian locus is sampled.
_TEMPERATURES = np.geomspace(1000, 100_000, 2000)

Array = NDArray[np.float64]


def colour_matching_functions(wavelengths_m: Array, observer: int = 2) -> Array:
    """Return the CIE colour matching functions x, y, z, (3, n).

    observer: of 2 or 10 degrees.
    """
    nm = np.asarray(wavelengths_m) * 1e9
    if observer == 2:
        x = 1.056 * _lobe(nm, 599.8, 37.9, 31.0) + 0.362 * _lobe(nm, 442.0, 16.0, 26.7)
        x = x - 0.065 * _lobe(nm, 501.1, 20.4, 26.2)
        y = 0.821 * _lobe(nm, 568.8, 46.9, 40.5) + 0.286 * _lobe(nm, 530.9, 16.3, 31.1)
        z = 1.217 * _lobe(nm, 437.0, 11.8, 36.0) + 0.681 * _lobe(nm, 459.0, 26.0, 13.8)
    else:
        x = 0.398 * np.exp(-1250 * np.log((nm + 570.1) / 1014) ** 2)
        x = x + 1.132 * np.exp(-234 * np.log((1338 - nm) / 743.5) ** 2)
        y = 1.011 * np.exp(-0.5 * ((nm - 556.1) / 46.14) ** 2)
        z = 2.060 * np.exp(-32 * np.log((nm - 265.8) / 180.4) ** 2)
    return np.stack([x, y, z])


def _lobe(nm: Array, centre: float, below: float, above: float) -> Array:
    return np.exp(-0.5 * ((nm - centre) / np.where(nm < centre, below, above)) ** 2)


def tristimulus(wavelengths_m: Array, radiance: Array, observer: int = 2) -> Array:
    """Return the tristimulus values X, Y, Z of a spectrum.

    Y is in cd/m² if the radiance is in W/(sr m² m).
    """
    step = float(wavelengths_m[1] - wavelengths_m[0])
    return KM * step * (colour_matching_functions(wavelengths_m, observer) @ radiance)


def chromaticity(xyz: Array) -> tuple[float, float]:
    """Return the chromaticity x, y of tristimulus values; NaN for a spectrum without light."""
    total = float(xyz.sum())
    return (float(xyz[0]) / total, float(xyz[1]) / total) if total > 0 else (math.nan, math.nan)


def uniform_chromaticity(xyz: Array) -> tuple[float, float]:
    """Return the CIE 1976 chromaticity u', v'; NaN for a spectrum without light."""
    bottom = float(xyz[0] + 15 * xyz[1] + 3 * xyz[2])
    if bottom <= 0:
        return math.nan, math.nan
    return 4 * float(xyz[0]) / bottom, 9 * float(xyz[1]) / bottom


def colour_temperature(wavelengths_m: Array, xyz: Array, observer: int = 2) -> tuple[float, float]:
    """Return the correlated colour temperature (K) and duv, the distance from the Planckian locus.

    The distance is measured in the diagram of 1960 and is positive above the locus. Both values are
    NaN beyond 0.05 from the locus or outside 1000 to 100 000 K.
    """
    u, v = uniform_chromaticity(xyz)
    if math.isnan(u):
        return math.nan, math.nan
    first, step = float(wavelengths_m[0]), float(wavelengths_m[1] - wavelengths_m[0])
    locus = _planckian_locus(first, step, len(wavelengths_m), observer)
    du, dv = u - locus[0], (v - locus[1]) * 2 / 3
    distance = np.hypot(du, dv)
    nearest = int(np.argmin(distance))
    if distance[nearest] > 0.05 or nearest in (0, len(_TEMPERATURES) - 1):
        return math.nan, math.nan
    # A parabola of the temperature's logarithm through three squared distances gives the minimum
    # between the samples.
    before, here, after = distance[nearest - 1 : nearest + 2] ** 2
    shift = 0.5 * (before - after) / (before - 2 * here + after)
    ratio = _TEMPERATURES[1] / _TEMPERATURES[0]
    least = math.sqrt(max(0.0, here - 0.25 * (before - after) * shift))
    return float(_TEMPERATURES[nearest] * ratio**shift), math.copysign(least, dv[nearest])


@functools.lru_cache(maxsize=8)
def _planckian_locus(first: float, step: float, count: int, observer: int) -> Array:
    """Return u', v' (2, n) of a black body at each of `_TEMPERATURES`.

    The wavelengths are evenly spaced.
    """
    wavelengths = (first + step * np.arange(count)).astype(np.float64)
    light = wavelengths**-5 / np.expm1(_C2 / np.outer(_TEMPERATURES, wavelengths))
    locus = light @ colour_matching_functions(wavelengths, observer).T
    bottom = locus @ np.array([1.0, 15.0, 3.0])
    both: Array = np.stack([4 * locus[:, 0], 9 * locus[:, 1]]) / bottom
    return both


def dominant_wavelength(wavelengths_m: Array, xyz: Array, observer: int = 2) -> tuple[float, float]:
    """Return the dominant wavelength (nm) and the excitation purity (%), from equal-energy white.

    Purples have the negative complementary wavelength. Both are NaN without light and for white.
    """
    x, y = chromaticity(xyz)
    dx, dy = x - 1 / 3, y - 1 / 3
    if not math.hypot(dx, dy) > 1e-9:
        return math.nan, math.nan
    # Beyond these wavelengths the fits are too dark for a meaningful chromaticity.
    seen = wavelengths_m[(wavelengths_m > 400e-9) & (wavelengths_m < 651e-9)]
    functions = colour_matching_functions(seen, observer)
    locus = functions[:2] / functions.sum(axis=0) - 1 / 3
    for sign in (1, -1):
        hit = _locus_crossing(locus, functions[1], sign * dx, sign * dy)
        if hit is None:
            continue
        index, far = hit
        nm = float(np.interp(index, np.arange(len(seen)), seen)) * 1e9
        if sign > 0:
            return nm, 100 * math.hypot(dx, dy) / far
        # The distance from white to the line of purples, which joins the ends of the locus.
        a, side = locus[:, 0], locus[:, -1] - locus[:, 0]
        along = (a[0] * side[1] - a[1] * side[0]) / (dx * side[1] - dy * side[0])
        return -nm, 100 * math.hypot(dx, dy) / float(along * math.hypot(dx, dy))
    return math.nan, math.nan


def _locus_crossing(locus: Array, seen: Array, dx: float, dy: float) -> tuple[float, float] | None:
    """Find where a ray from white crosses the spectral locus: fractional index and distance.

    Of several crossings, as in the violet, that where `seen` is largest counts.
    """
    across = locus[0] * dy - locus[1] * dx
    along = locus[0] * dx + locus[1] * dy
    changes = np.flatnonzero((across[:-1] * across[1:] <= 0) & (along[:-1] > 0))
    if not len(changes):
        return None
    i = int(changes[np.argmax(seen[changes])])
    share = float(across[i] / (across[i] - across[i + 1])) if across[i] != across[i + 1] else 0.0
    point = locus[:, i] + share * (locus[:, i + 1] - locus[:, i])
    return i + share, float(np.hypot(*point))
