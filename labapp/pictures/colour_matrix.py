"""Compute the matrix from a colour sensor's channels to linear sRGB, and apply it.

A camera's channels aren't the eye's: its red filter passes other wavelengths. A matrix turns one
into the other, as well as a linear map can. It depends on the light of the scene, and acts on
channels that are white-balanced: divided by what white gives in each.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from labapp.common.colour_library import colour_library
from optics.light import Spectrum, blackbody
from optics.sensor import Mosaic

VISIBLE_RANGE = (380e-9, 780e-9)
"""Shortest and longest wavelength in metres that colours are computed from, as CIE 15 recommends.
What a sensor detects beyond them is left out."""

ILLUMINANT_A_TEMPERATURE = 2855.54
"""Temperature in kelvin of the black body that is CIE standard illuminant A: the 2848 K of 1931,
with the second radiation constant of today."""

TRAINING_REFLECTANCES = "ColorChecker N Ohta"
"""Name in colour-science of the reflectances that the matrix is fitted to: the 24 patches of a
ColorChecker, measured by Ohta (1997) from 380 to 780 nm."""

LARGEST_NOISE_AMPLIFICATION = 12.0
"""Largest photon noise in a channel of sRGB, over that of the sensor's channel with the most light;
both at white, as shares of white. The packaged DVC 4000C has 4 in light of illuminant A and 10 by
candlelight, a black body of 1900 K. With a filter for 520 to 620 nm it would have 15, and blue
would be a guess."""

_LEAST_DIFFERENCE = 1e-3
"""Differences between balanced channels that count, rms over the reflectances, as a share of white.
At the largest amplification, smaller ones would change sRGB by 1 % of white or less."""

_STEP = 1e-9
"""Distance in metres between the wavelengths of a sum over the visible range."""


def linear_srgb_matrix(
    mosaic: Mosaic,
    light: Spectrum | None = None,
    passband: tuple[float, float] | None = None,
) -> NDArray[np.float64]:
    """Compute the matrix from a sensor's white-balanced channels to linear sRGB.

    The matrix is the least-squares fit to the 24 reflectances ``ColorChecker N Ohta`` of the
    library colour-science. A channel's signal is the sum over wavelength of reflectance, light,
    wavelength (so that photons are counted) and efficiency. The goal is the CIE 1931 colour of the
    reflectance in the same light, without the filter, adapted from the light's white to D65 by
    Bradford's transform. White stays white: each row sums to 1. Finlayson and Drew, "White-point
    preserving color correction", Color Imaging Conference 1997; IEC 61966-2-1 (sRGB); CIE 15
    (colorimetry).

    Returns (3, channels), float64: from channels in the order of ``mosaic.channels``, each divided
    by what white gives in it, to linear sRGB, in which white is (1, 1, 1). ValueError if colours
    can't be told apart: there are fewer than three channels, a channel gets no light, or channels
    are so alike that the noise of sRGB would exceed `LARGEST_NOISE_AMPLIFICATION`. Also for a
    passband that runs backwards or is invisible, and for a light that is dark in it.

    mosaic: of more than three channels, directions in which they are too alike are left out of the
        fit.
    light: power by wavelength on the scene, on any scale; a halogen lamp, CIE illuminant A, by
        default.
    passband: shortest and longest wavelength in metres that a filter in front of the camera
        transmits; the visible, 380 to 780 nm, by default. Light beyond the visible isn't counted.
    """
    light = _illuminant_a() if light is None else light
    low, high = _visible_passband(passband)
    names = ", ".join(mosaic.channels)
    if len(mosaic.channels) < 3:
        raise ValueError(
            f"colours can't be told apart by {len(mosaic.channels)} channels ({names}); take a "
            "sensor with three or more, or make a grey picture"
        )
    white = _white_signals(mosaic, light, (low, high))
    shines = max(low, light.low), min(high, light.high)
    span = f"{_nanometres(shines[0])} to {_nanometres(shines[1])} nm"
    if not white.all():
        dark = mosaic.channels[int(np.argmin(white))]
        raise ValueError(
            f"colours can't be told apart in light of {span}: channel {dark} gets none of it. "
            f"{_remedy(passband)}"
        )
    patches = colour_library().SDS_COLOURCHECKERS[TRAINING_REFLECTANCES].values()
    nm = _wavelengths() * 1e9
    reflectances = np.array([np.interp(nm, one.wavelengths, one.values) for one in patches])
    photons = _photons(light, (low, high))
    signals = reflectances * photons @ _efficiencies(mosaic).T / white
    # White lies along (1, …, 1). What the rows do to it is fixed; the fit is across it.
    mean = np.full((3, len(white)), 1 / len(white))
    across = np.linalg.svd(np.ones((1, len(white))))[2][1:].T
    u, size, v = np.linalg.svd(signals @ across, full_matrices=False)
    count = int((size > _LEAST_DIFFERENCE * math.sqrt(len(signals))).sum())
    if count < 2:
        raise ValueError(
            f"colours can't be told apart in light of {span}: the channels {names} differ in fewer "
            f"than two ways by more than {_LEAST_DIFFERENCE:.1%} of white. {_remedy(passband)}"
        )
    missing = _linear_srgb_of(reflectances, light) - signals @ mean.T
    noise = np.sqrt(white.max() / white)
    # Two differences make colours. Further ones are used while they don't cost too much noise.
    for kept in range(count, 1, -1):
        fit = (missing.T @ u[:, :kept] / size[:kept]) @ v[:kept]
        matrix = mean + fit @ across.T
        amplification = float(np.linalg.norm(matrix * noise, axis=1).max())
        if amplification <= LARGEST_NOISE_AMPLIFICATION:
            return matrix
    raise ValueError(
        f"colours can't be told apart in light of {span}: a matrix from the channels {names} to "
        f"sRGB would amplify noise {amplification:.3g} times, and "
        f"{LARGEST_NOISE_AMPLIFICATION:g} is the most. {_remedy(passband)}"
    )


def white_balance(
    mosaic: Mosaic,
    light: Spectrum | None = None,
    passband: tuple[float, float] | None = None,
) -> NDArray[np.float64]:
    """Compute what a white surface gives in each channel, relative to the largest one.

    Returns (channels,), float64, in the order of ``mosaic.channels``; 0 for a channel that gets no
    light. `light` and `passband` are as in `linear_srgb_matrix`. ValueError if no channel gets any
    light, or the passband runs backwards or is invisible.
    """
    light = _illuminant_a() if light is None else light
    white = _white_signals(mosaic, light, _visible_passband(passband))
    return white / white.max()


def linear_srgb(
    picture: NDArray[np.floating], matrix: NDArray[np.floating]
) -> NDArray[np.floating]:
    """Apply a colour matrix to white-balanced channels, and return linear sRGB, (3, rows, columns).

    The result has the precision of the channels. Colours out of sRGB's gamut have negative values
    or values above 1; the caller clips them. ValueError if a shape is wrong, or the matrix is for
    another number of channels.

    picture: (channels, rows, columns), each channel divided by what white gives in it.
    matrix: (3, channels), as `linear_srgb_matrix` returns it.
    """
    picture, matrix = np.asarray(picture), np.asarray(matrix)
    if matrix.ndim != 2 or len(matrix) != 3:
        raise ValueError(f"matrix is {matrix.shape}; it must be (3, channels)")
    if picture.ndim != 3 or len(picture) != matrix.shape[1]:
        raise ValueError(
            f"picture is {picture.shape}; with this matrix it must be ({matrix.shape[1]}, rows, "
            "columns)"
        )
    precision = np.result_type(picture, np.float32)
    return np.tensordot(matrix.astype(precision), picture.astype(precision), axes=1)


def _illuminant_a() -> Spectrum:
    return blackbody(ILLUMINANT_A_TEMPERATURE)


def _wavelengths() -> NDArray[np.float64]:
    low, high = VISIBLE_RANGE
    return np.linspace(low, high, round((high - low) / _STEP) + 1)


def _visible_passband(passband: tuple[float, float] | None) -> tuple[float, float]:
    """Return the visible part of a passband in metres; ValueError if there is none."""
    low, high = VISIBLE_RANGE if passband is None else passband
    if not 0 < low < high < math.inf:
        raise ValueError(f"passband is {low:g} to {high:g} m; give the shorter wavelength first")
    inside = max(low, VISIBLE_RANGE[0]), min(high, VISIBLE_RANGE[1])
    if inside[0] >= inside[1]:
        raise ValueError(
            f"passband is {_nanometres(low)} to {_nanometres(high)} nm, which is invisible; give "
            "metres between 380e-9 and 780e-9"
        )
    return inside


def _power(light: Spectrum, passband: tuple[float, float]) -> NDArray[np.float64]:
    """Return the light's power around each wavelength of the sum, within the passband.

    It is integrated, not sampled, so that no line of the light falls between two wavelengths.
    """
    borders = np.clip(
        np.append(_wavelengths() - _STEP / 2, VISIBLE_RANGE[1]), passband[0], passband[1]
    )
    return np.array([light.integral(a, b) for a, b in pairwise(borders)])


def _photons(light: Spectrum, passband: tuple[float, float]) -> NDArray[np.float64]:
    power = _power(light, passband)
    if not power.any():
        raise ValueError(
            f"light is dark from {_nanometres(passband[0])} to {_nanometres(passband[1])} nm; "
            "give one that shines there"
        )
    return power / power.max() * _wavelengths()


def _efficiencies(mosaic: Mosaic) -> NDArray[np.float64]:
    return np.array([mosaic.efficiencies[name].at(_wavelengths()) for name in mosaic.channels])


def _white_signals(
    mosaic: Mosaic, light: Spectrum, passband: tuple[float, float]
) -> NDArray[np.float64]:
    """Return what white gives in each channel; ValueError if it gives nothing in any."""
    white: NDArray[np.float64] = _efficiencies(mosaic) @ _photons(light, passband)
    if not white.any():
        raise ValueError(
            f"no channel of {', '.join(mosaic.channels)} detects this light from "
            f"{_nanometres(passband[0])} to {_nanometres(passband[1])} nm; give another passband"
        )
    return white


def _linear_srgb_of(reflectances: NDArray[np.float64], light: Spectrum) -> NDArray[np.float64]:
    """Return the linear sRGB of reflectances in a light that the eye is adapted to, (…, 3)."""
    colour = colour_library()
    shape = colour.SpectralShape(*(round(one * 1e9) for one in (*VISIBLE_RANGE, _STEP)))
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(shape)
    power = colour.SpectralDistribution(_power(light, VISIBLE_RANGE), shape.wavelengths)
    white = np.ones((1, reflectances.shape[1]))
    xyz = colour.msds_to_XYZ(
        np.concatenate([reflectances, white]), observer, power, method="Integration", shape=shape
    )
    return colour.XYZ_to_RGB(
        xyz[:-1] / xyz[-1, 1],
        "sRGB",
        illuminant=colour.XYZ_to_xy(xyz[-1]),
        chromatic_adaptation_transform="Bradford",
    )


def _nanometres(wavelength: float) -> str:
    return f"{wavelength * 1e9:.4g}"


def _remedy(passband: tuple[float, float] | None) -> str:
    wider = "" if passband is None else "a wider filter, or "
    return f"Take {wider}light of more wavelengths, or make a grey picture."
