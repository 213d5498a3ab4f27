"""The MTF of a camera from a picture of a slanted edge (ISO 12233, e-SFR)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from optics.validation import require_unmasked

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class EdgeResponse:
    """MTF and edge spread function across a slanted edge.

    frequencies: cycles per pixel across the edge.
    mtf: 1 at frequency 0.
    angle: radians between the edge and the columns, or the rows if `horizontal`.
    edge_spread: the oversampled edge spread function at `positions`, which are pixels from the
        edge.
    """

    frequencies: Array
    mtf: Array
    angle: float
    horizontal: bool
    positions: Array
    edge_spread: Array

    def mtf_at(self, frequencies: ArrayLike) -> Array:
        """Interpolate the MTF linearly at frequencies in cycles per pixel.

        Raises ValueError for frequencies beyond the highest measured one.
        """
        asked = np.asarray(frequencies, dtype=np.float64)
        if asked.size and (asked.min() < 0 or asked.max() > self.frequencies[-1]):
            raise ValueError(
                f"frequencies reach {asked.max():g} cycles a pixel; 0 to "
                f"{self.frequencies[-1]:g} are known"
            )
        return np.interp(asked, self.frequencies, self.mtf)


def measure_edge_response(picture: ArrayLike, oversampling: int = 4) -> EdgeResponse:
    """Measure the MTF across a slanted edge from its picture (ISO 12233).

    picture: (rows, columns), linear in the light, of one edge between two uniform sides. The edge
        passes through all rows, or all columns, at an angle of a few degrees.

    Each row's edge is the centroid of the row's derivative. A line is fitted to these centroids,
    and all pixels are sorted by their distance from it into bins 1 / `oversampling` pixels wide.
    The differences of neighbouring bins are windowed and Fourier transformed. The average over a
    bin and the difference in place of a derivative each attenuate by sinc(f / oversampling); both
    factors are divided out. Raises ValueError for a picture without an edge, or an edge too upright
    to fill all bins.
    """
    require_unmasked(picture)
    values = np.asarray(picture, dtype=np.float64)
    if values.ndim != 2 or min(values.shape) < 16:
        raise ValueError(f"picture is {values.shape}; give 16 rows and columns or more")
    if not np.isfinite(values).all():
        raise ValueError("picture has numbers that aren't finite")
    if oversampling < 1:
        raise ValueError(f"oversampling is {oversampling}; give 1 or more, 4 as the standard does")
    down, across = (np.abs(np.diff(values.sum(1 - axis))).max() for axis in (0, 1))
    horizontal = bool(down > across)
    if horizontal:
        values = values.T
    offset, slope = _fit_edge_line(values)
    places, edge = _edge_spread(values, offset, slope, oversampling)
    spread = np.diff(edge)
    # Tukey's window is flat, with cosine tapers of this share of it.
    taper, count = 0.3, len(spread)
    place = np.abs(np.arange(count) - (count - 1) / 2) / (count / 2)
    window = 0.5 * (1 + np.cos(np.pi * np.clip((place - (1 - taper)) / taper, 0, 1)))
    transform = np.abs(np.fft.rfft(spread * window))
    frequencies = np.fft.rfftfreq(count, 1 / oversampling)
    known = frequencies <= min(1.0, oversampling / 2)
    mtf = transform / transform[0] / np.sinc(frequencies / oversampling) ** 2
    angle = math.atan(slope)
    at = np.asarray(frequencies[known], dtype=np.float64)
    return EdgeResponse(at, mtf[known], angle, horizontal, places, edge)


def _fit_edge_line(values: Array) -> tuple[float, float]:
    """Fit a line to the edge: column at row 0, and slope in columns per row."""
    derivative = np.diff(values, axis=1)
    if not np.abs(derivative).max() > 1e-9 * max(np.abs(values).max(), 1e-300):
        raise ValueError("picture has no edge: it is the same everywhere")
    columns = np.arange(derivative.shape[1]) + 0.5
    rows = np.arange(len(values))
    weights = np.ones_like(derivative)
    offset = slope = 0.0
    half_width = 6.0  # After the first pass, 6 pixels on either side count.
    for _ in range(3):
        strength = (derivative * weights).sum(1)
        if (strength == 0).any() or (np.sign(strength) != np.sign(strength[0])).any():
            raise ValueError("picture has rows without the edge; cut it out so that it is in all")
        centroid = (derivative * weights * columns).sum(1) / strength
        slope, offset = np.polyfit(rows, centroid, 1)
        away = columns - (offset + slope * rows)[:, None]
        inside = np.abs(away) < half_width
        weights = np.where(inside, np.cos(np.pi * away / (2 * half_width)) ** 2, 0.0)
    return float(offset), float(slope)


def _edge_spread(
    values: Array, offset: float, slope: float, oversampling: int
) -> tuple[Array, Array]:
    """Compute the oversampled edge spread function.

    Returns the centres of the bins in pixels from the edge, and the mean of the pixels in each.
    """
    rows, columns = values.shape
    line = offset + slope * np.arange(rows)
    cosine = 1 / math.hypot(1, slope)
    distance = (np.arange(columns) - line[:, None]) * cosine
    # This is the largest distance from the edge at which every row has pixels on both sides.
    reach = cosine * min(line.min(), (columns - 1 - line).min())
    half = math.floor(reach * oversampling)
    if half < 4 * oversampling:
        raise ValueError(
            f"picture has {max(reach, 0):.1f} pixels beside the edge in some row; give 4 or more "
            "on both sides"
        )
    number = np.floor(distance * oversampling).astype(int) + half
    inside = (number >= 0) & (number < 2 * half)
    count = np.bincount(number[inside], minlength=2 * half)
    if (count == 0).any():
        raise ValueError(
            f"the edge leans by {abs(slope) * rows:.2g} pixels over {rows} rows, too little to "
            f"tell {oversampling} places in a pixel; turn it by about 5 degrees, or take more rows"
        )
    total = np.bincount(number[inside], values[inside], minlength=2 * half)
    return (np.arange(2 * half) - half + 0.5) / oversampling, total / count
