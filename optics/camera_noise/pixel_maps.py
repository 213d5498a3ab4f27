"""Average a group of pixels over all frames: dark signal, dark current and response of each pixel.

Every map is made twice, from the first and from the second frames of the pairs. Both halves share
what is fixed, and none of the noise, so that their covariance over the pixels is the variance of
the fixed pattern without bias, whatever the noise.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from optics.camera_noise.paired_frames import Pairs

Map = NDArray[np.float64]
Halves = tuple[Map, Map]
Mask = NDArray[np.bool_]

BOX = 15
"""Side in pixels of the box whose mean is the light around a pixel. Chosen: smooth light,
vignetting and shading are taken off, and of the pixels' own spread 1/BOX²."""


@dataclass(frozen=True, eq=False)
class GroupMaps:
    """Maps of a group of a camera's pixels, (rows, columns) each.

    dark: halves of the mean dark number at the exposure times of the light, DN. current: growth of
    the dark number with the exposure time, DN/s. response: halves of each pixel's light over the
    group's mean; None where no exposure is bright and unclipped.
    """

    dark: Halves
    current: Map
    response: Halves | None

    @property
    def mean_dark(self) -> Map:
        """Mean dark number of each of the camera's pixels, DN."""
        return (self.dark[0] + self.dark[1]) / 2


def average_frames(
    frames: NDArray[Any], light: Pairs, dark: Pairs, bright: Iterable[float]
) -> GroupMaps:
    """Average all frames of a group of a camera's pixels, (frames, rows, columns).

    bright: exposure times whose light is clear of darkness and of clipping.
    """
    longest = max(light)
    short = {time: pairs for time, pairs in dark.items() if time <= longest}
    dark_halves = _half_means(frames, [pair for pairs in short.values() for pair in pairs])
    chosen = list(bright)
    response: Halves | None = None
    if chosen:
        lit = _half_means(frames, [pair for time in chosen for pair in light[time]])
        # Darks of the same exposure times, so that a hot pixel's own current is taken off.
        base = _half_means(frames, [pair for time in chosen for pair in dark[time]])
        differences = [one - other for one, other in zip(lit, base, strict=True)]
        response = differences[0] / differences[0].mean(), differences[1] / differences[1].mean()
    return GroupMaps(dark_halves, _growth(frames, dark), response)


def _half_means(frames: NDArray[Any], pairs: list[tuple[int, int]]) -> Halves:
    """Return the means of a camera's first and of its second frames of pairs."""
    halves = []
    for side in (0, 1):
        total = np.zeros(frames.shape[1:])
        for pair in pairs:
            total += frames[pair[side]]
        halves.append(total / len(pairs))
    return halves[0], halves[1]


def _growth(frames: NDArray[Any], dark: Pairs) -> Map:
    """Return the slope of each of the camera's pixels over the exposure time of its dark frames."""
    listed = [(time, index) for time, pairs in dark.items() for pair in pairs for index in pair]
    middle = float(np.mean([time for time, _ in listed]))
    weights = [time - middle for time, _ in listed]
    total = np.zeros(frames.shape[1:])
    for weight, (_, index) in zip(weights, listed, strict=True):
        total += weight * frames[index]
    return np.asarray(total / sum(weight**2 for weight in weights))


def local_mean(response: Map, good: Mask) -> Map:
    """Return the mean response of the good pixels around each of a camera's pixels.

    A paraboloid over all of them is taken off first, so that the border is as good as the middle.
    """
    slow = _paraboloid(response, good)
    shares = uniform_filter(good.astype(np.float64), BOX, mode="reflect")
    total = uniform_filter(np.where(good, response / slow, 0.0), BOX, mode="reflect")
    # Where all pixels around are defective, the paraboloid is all that is known of the light.
    known = shares > 0.5 / BOX**2
    return slow * np.where(known, total / np.where(known, shares, 1.0), 1.0)


def _paraboloid(response: Map, good: Mask) -> Map:
    """Fit a paraboloid to a camera's response; it is never below a tenth of the mean."""
    y, x = (np.linspace(-1, 1, n) for n in response.shape)
    terms = np.stack([
        np.broadcast_to(term, response.shape)
        for term in (np.ones((1, 1)), y[:, None], x, y[:, None] ** 2, y[:, None] * x, x**2)
    ], axis=-1)  # fmt: skip
    own = terms[good]
    weights = np.linalg.solve(own.T @ own + 1e-9 * np.eye(6), own.T @ response[good])
    return np.maximum(terms @ weights, 0.1 * float(response[good].mean()))


def without_slow_changes(response: Map, good: Mask) -> Map:
    """Return a camera's response over that of its surroundings, less 1, and 0 at defects."""
    return np.where(good, response / np.where(good, local_mean(response, good), 1.0) - 1, 0.0)
