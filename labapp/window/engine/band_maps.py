"""Maps of what is uncertain or wrong in each band of a restored cube."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from labapp.files.cubes import SpectralCube
from labapp.window.spectral_messages import BandMap

_PERCENTILE = 99.0
"""Percentile of a map's values, over all bands, that its scale reaches at least. Chosen: single
pixels at edges would make all others look alike."""

_LEAST_HIGHEST = 0.01
"""Least upper end of a scale in shares of white. Chosen: what is smaller can't be seen."""

_RESIDUAL_REACH = 4.0
"""Upper end of the residual's scale, in standard deviations of the noise. Chosen: noise alone
exceeds it in one pixel of 16 000."""


def list_maps(
    cube: SpectralCube, truth: SpectralCube | None, residual: NDArray[np.floating]
) -> tuple[BandMap, ...]:
    """List the maps of a cube: error, if it has one, difference from a known truth, residual.

    The residual, which isn't one of bands, is last.
    residual: the snapshot less the blurred cube, over the noise, (rows, columns); NaN where it
        isn't known.
    """
    maps = []
    if cube.error is not None:
        maps.append(_error_map(np.asarray(cube.error)))
    if truth is not None:
        maps.append(_difference_map(cube.values - truth.values))
    return (*maps, _residual_map(residual))


def _error_map(error: NDArray[np.float32]) -> BandMap:
    highest = _scale_end(error)
    return BandMap(
        "Error",
        "Half width of the interval that holds the true value with a probability of 90 %",
        "90 % error, share of white",
        0.0,
        highest,
        _as_levels(error, 0.0, highest),
    )


def _difference_map(difference: NDArray[np.float32]) -> BandMap:
    highest = _scale_end(np.abs(difference))
    return BandMap(
        "Difference",
        "The restored band less the true one: blue is too dark, amber too bright",
        "restored less true, share of white",
        -highest,
        highest,
        _as_levels(difference, -highest, highest),
    )


def _residual_map(residual: NDArray[np.floating]) -> BandMap:
    reach = _RESIDUAL_REACH
    return BandMap(
        "Unexplained",
        "The snapshot less the blurred cube, of all bands together. It should look like noise",
        "unexplained, over the noise",
        -reach,
        reach,
        _as_levels(np.nan_to_num(residual)[None], -reach, reach),
    )


def _scale_end(sizes: NDArray[np.floating]) -> float:
    """Return the upper end of a map's scale: 1, 2 or 5 times a power of ten."""
    wanted = max(float(np.percentile(sizes, _PERCENTILE)), _LEAST_HIGHEST)
    power = 10.0 ** math.floor(math.log10(wanted))
    return next((k * power for k in (1, 2, 5) if k * power >= wanted), 10 * power)


def _as_levels(values: NDArray[np.floating], lowest: float, highest: float) -> NDArray[np.uint8]:
    """Scale a map's values to the levels 0 to 255 of a palette."""
    share = (values - lowest) / (highest - lowest)
    return np.rint(255 * np.clip(share, 0, 1)).astype(np.uint8)
