"""The place and the light of a small star, from a merged picture of it behind colour filters.

A star that is a pixel wide falls between the few pixels that see its colour: a centroid of
interpolated pixels would be half a pixel wrong. A spot of known shape is fitted to the bare pixels
instead, each with the sensitivity of its filter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, least_squares
from scipy.special import erf

Picture = NDArray[np.float64]

# Pixels around the brightest one to which the spot is fitted. Chosen: four times the period of
# Bayer's pattern.
_REACH = 8

# Pixels around a star's middle that show the light of its shape: rings of three pixels and more
# leave them dark.
_CORE = 2

# Deviation of a star's shape from a Gaussian, over its brightest pixel, that counts as noise.
# Measured: an Airy disc of 1.2 pixels on a pixel and its neighbours leaves 0.03 to 0.06.
_SHAPE_ERROR = 0.05

# Pixels from the brightest one at which fits begin: a star on the pixel of another colour is
# brightest beside its place.
_START_OFFSETS = (-0.6, 0.0, 0.6)

_SIGMAS = (0.2, 4.0)  # pixels; least and largest standard deviation of a spot


@dataclass(frozen=True)
class StarSpot:
    """Place and light of a star, seen as a Gaussian.

    y, x: place of its middle, pixels.
    sigma: standard deviation of the Gaussian, pixels.
    light: electrons per second that all its light would give behind a filter of sensitivity 1.
    deviation: estimated standard deviation of the place, pixels.
    """

    y: float
    x: float
    sigma: float
    light: float
    deviation: float

    def shape_on(self, rows: int, columns: int) -> Picture:
        """Return the star's shape on the pixels of a frame, as shares of its light."""
        places = np.arange(rows), np.arange(columns)
        return _gaussian_spot(places, (self.y, self.x, math.log(self.sigma), 0.0))

    def share_in(self, rate: Picture, variance: Picture, sensitivity: Picture) -> float:
        """Estimate how much of another picture's light has the star's shape and place.

        The shape is fitted by least squares to the pixels around the star. Of a star that a pattern
        spreads out, this is the light that stays in the middle: electrons per second, 0 or more.
        Pictures are as for `fit_star_spot`.
        """
        shape = sensitivity * self.shape_on(*rate.shape)
        near = round(self.y), round(self.x)
        part = tuple(slice(max(at - _CORE, 0), at + _CORE + 1) for at in near)
        shape, seen, spread = shape[part], rate[part], variance[part]
        known = np.isfinite(spread) & (shape > 0)
        trust = np.where(known, 1 / np.where(known & (spread > 0), spread, 1.0), 0.0)
        power = float((trust * shape**2).sum())
        return max(float((trust * shape * seen).sum()) / power, 0.0) if power > 0 else 0.0


def fit_star_spot(
    rate: Picture, variance: Picture, sensitivity: Picture, near: tuple[int, int]
) -> StarSpot | None:
    """Fit a Gaussian, integrated over pixels behind their filters; None if it is dark there.

    rate, variance: (rows, columns), light of each pixel and its variance; infinite where a pixel is
        clipped.
    sensitivity: (rows, columns), share of the star's light that each pixel's filter transmits; not
        negative.
    near: pixel (row, column) within two pixels of the star.
    """
    rows, columns = (
        slice(max(at - _REACH, 0), min(at + _REACH + 1, n))
        for at, n in zip(near, rate.shape, strict=True)
    )
    seen, share = rate[rows, columns], sensitivity[rows, columns]
    known = np.isfinite(variance[rows, columns]) & (share > 0)
    peak = float(np.where(known, seen, 0).max(initial=0))
    if not peak > 0:
        return None
    modelled = (_SHAPE_ERROR * peak) ** 2 * (share / share.max())
    spread = np.where(known, variance[rows, columns], 0) + modelled
    places = np.arange(rows.start, rows.stop), np.arange(columns.start, columns.stop)
    trust = known / np.sqrt(spread)

    def misfit(parameters: Picture) -> Picture:
        spot = share * _gaussian_spot(places, parameters)
        return ((spot - seen) * trust).ravel()

    def slopes(parameters: Picture) -> Picture:
        parts = _spot_slopes(places, parameters)
        return np.stack([(share * slope * trust).ravel() for slope in parts], axis=1)

    low, high = (math.log(one) for one in _SIGMAS)
    bounds = (
        [near[0] - 3.0, near[1] - 3.0, low, -np.inf],
        [near[0] + 3.0, near[1] + 3.0, high, np.inf],
    )
    light = peak / float(share.max())
    # From several starts around the pixel, because the misfit has several minima.
    fits = [
        least_squares(
            misfit,
            [near[0] + down, near[1] + along, math.log(0.6), math.log(2 * light)],
            slopes,
            bounds=bounds,
        )
        for down in _START_OFFSETS
        for along in _START_OFFSETS
    ]
    best = min(fits, key=lambda one: float(one.cost))
    y, x, log_sigma, log_light = map(float, best.x)
    return StarSpot(y, x, math.exp(log_sigma), math.exp(log_light), _place_deviation(best))


def _gaussian_spot(
    places: tuple[NDArray[np.int_], NDArray[np.int_]], parameters: Sequence[float] | Picture
) -> Picture:
    """Return the light on each pixel, for (y, x, log of width, log of light).

    It is a Gaussian, integrated over each pixel.
    """
    lines = [np.diff(erf(edges)) / 2 for edges in _pixel_edges(places, parameters)]
    spot: Picture = math.exp(parameters[3]) * np.outer(*lines)
    return spot


def _pixel_edges(
    places: tuple[NDArray[np.int_], NDArray[np.int_]], parameters: Sequence[float] | Picture
) -> list[Picture]:
    """Return the pixels' edges in rows and columns, from the star's middle in its widths."""
    width = math.sqrt(2) * math.exp(parameters[2])
    return [
        (np.append(place - 0.5, place[-1] + 0.5) - middle) / width
        for place, middle in zip(places, parameters[:2], strict=True)
    ]


def _spot_slopes(
    places: tuple[NDArray[np.int_], NDArray[np.int_]], parameters: Sequence[float] | Picture
) -> tuple[Picture, Picture, Picture, Picture]:
    """Return how the light on each pixel changes with each parameter of `_gaussian_spot`."""
    width = math.sqrt(2) * math.exp(parameters[2])
    lines, moved, widened = [], [], []
    for edges in _pixel_edges(places, parameters):
        bell = np.exp(-(edges**2)) / math.sqrt(math.pi)
        lines.append(np.diff(erf(edges)) / 2)
        moved.append(-np.diff(bell) / width)
        widened.append(-np.diff(edges * bell))
    (down, along), light = lines, math.exp(parameters[3])
    return (
        light * np.outer(moved[0], along),
        light * np.outer(down, moved[1]),
        light * (np.outer(widened[0], along) + np.outer(down, widened[1])),
        light * np.outer(down, along),
    )


def _place_deviation(fit: OptimizeResult) -> float:
    """Return the standard deviation of a fitted place in pixels, at most the reach."""
    information = fit.jac.T @ fit.jac
    covariance = np.linalg.pinv(information)
    variance = float(np.clip(np.diag(covariance)[:2], 0, None).max())
    # A fit that explains the picture badly is trusted less.
    excess = max(2 * float(fit.cost) / max(len(fit.fun) - 4, 1), 1.0)
    return min(math.sqrt(variance * excess), float(_REACH))
