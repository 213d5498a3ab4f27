"""True bands: photographs through the neutral pattern, one wavelength at a time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from labapp.pictures.analysis.brackets import WAVELENGTH_TOLERANCE, Bracket
from labapp.pictures.analysis.colour_filters import described_filters
from labapp.runs.record.reader import Record

Picture = NDArray[np.float64]


def find_stack(
    brackets: list[Bracket], target: str, pattern: str, wavelengths: Sequence[float]
) -> list[Bracket]:
    """Find the pictures of a target with a pattern in all bands (metres) among merged pictures.

    There are none if one is missing: a cube can only be judged whole.
    """
    own = [one for one in brackets if (one.target, one.pattern) == (target, pattern)]
    stack = []
    for wavelength in wavelengths:
        at = [one for one in own if abs(one.wavelength - wavelength) < WAVELENGTH_TOLERANCE]
        if not at:
            return []
        stack.append(at[0])
    return stack


def separate_neutral_bands(
    record: Record, stack: Sequence[Bracket], dead: NDArray[np.bool_]
) -> Picture:
    """Estimate the light of each neutral photograph at each pixel, (bands, rows, columns).

    Behind colour filters, the light of the filter that sees most of the band is estimated in all
    pixels (thesis Eq. 4.7). Dead pixels, (rows, columns), are filled in from their neighbours.
    """
    return np.stack([_separate_band(record, one, dead) for one in stack])


def coded_light_share(coded: Sequence[Bracket], neutral: Sequence[Bracket]) -> Picture:
    """Measure the share of the light of each band that the coded pattern passes, (bands,).

    It is the light of the coded picture of a target over that of the neutral one. What crosses the
    border of the frame inwards and outwards is taken to be equal.
    """
    pairs = zip(coded, neutral, strict=True)
    return np.array([a.rate.sum() / max(float(b.rate.sum()), 1e-300) for a, b in pairs])


def _separate_band(record: Record, picture: Bracket, dead: NDArray[np.bool_]) -> Picture:
    """Estimate the light of one photograph at each pixel, (rows, columns)."""
    filters = described_filters(record, picture, is_grey=True)
    clipped = ~np.isfinite(picture.variance)
    if filters is None:
        return np.where(dead, _median_of_neighbours(picture.rate, dead), picture.rate)
    known = picture.variance[~(clipped | dead)]
    noise = float(np.sqrt(known.mean())) if known.size else 0.0
    rate = np.where(dead, np.nan, picture.rate)
    return filters.separate(rate, noise, clipped)[0].astype(np.float64)


def _median_of_neighbours(rate: Picture, dead: NDArray[np.bool_]) -> Picture:
    """Return a picture whose dead pixels have the median of the sound ones among 3 x 3."""
    filled = rate.copy()
    for y, x in np.argwhere(dead):
        part = slice(max(y - 1, 0), y + 2), slice(max(x - 1, 0), x + 2)
        sound = rate[part][~dead[part]]
        filled[y, x] = float(np.median(sound)) if sound.size else 0.0
    return filled
