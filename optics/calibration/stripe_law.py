"""How much light stripes of two levels send into their first order."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RectBivariateSpline
from scipy.ndimage import correlate1d
from scipy.special import ndtr

from optics.gauss_legendre import gauss_legendre
from optics.validation import require_positive

Array = NDArray[np.float64]

MOST_BLUR = 1.5
"""Pixels, standard deviation, up to which the law is known."""

_BLURS = (0.0, 0.1, 0.2, 0.3, 0.42, 0.55, 0.7, 0.85, 1.0, 1.25, MOST_BLUR)
_REACH = 5.0
"""Standard deviations beyond which a blur reaches nothing."""

_NODES, _WEIGHTS = gauss_legendre(7)
"""Along an axis of a pixel's active area, at which the phase is looked at."""

_PATCH = 160
"""Pixels along an axis of the part of a pattern that stands for all of it."""

_HEIGHTS = 257
"""Between the two levels, into which the blurred pattern is sorted."""

_STEP_SPACING = 0.05
"""Radians between the steps at which the law is computed; it is a spline between them."""

_GAUSS_HERMITE = ((-math.sqrt(3.0), 1 / 6), (0.0, 2 / 3), (math.sqrt(3.0), 1 / 6))
"""Gauss-Hermite nodes, in standard deviations, of what isn't still."""


class StripeLaw:
    """The light in a first order, by the step between the levels and the neighbours' blur.

    upper: (rows, columns), where the pattern has the upper level; a part of it stands for the
    whole. vector: of its grating, (y, x) cycles per pixel. active_side: of the square of a pixel
    that modulates, in pixels. max_step: radians, up to which it is known.

    Hard stripes send sin²(step / 2) of what they can into each first order. Where neighbours
    blur the phase, it passes through all values between the two levels, over the edges as the
    pixels really have them: the pattern is blurred by a Gaussian, looked at in the active areas,
    and sorted by height, each point with the first order's wave. The light is in units of what
    hard stripes send at most.
    """

    def __init__(
        self, upper: NDArray[np.bool_], vector: Array, active_side: float, max_step: float
    ) -> None:
        require_positive("max_step", max_step, "rad")
        if not 0 < active_side <= 1:
            raise ValueError(
                f"active_side is {active_side:g} pixels; it must be positive and at most 1"
            )
        self.period = 1 / float(np.hypot(*vector))
        if not self.period >= 2:
            raise ValueError(f"vector is {vector}; stripes need two pixels or more a period")
        patch = upper[:_PATCH, :_PATCH].astype(np.float64)
        wave = _first_order_wave(patch.shape, vector)
        steps = np.arange(0, max_step + 2 * _STEP_SPACING, _STEP_SPACING)
        turned = np.exp(1j * np.outer(steps, np.linspace(0, 1, _HEIGHTS)))
        light = np.stack(
            [
                np.abs(turned @ _wave_by_height(patch, wave, vector, blur, active_side)) ** 2
                for blur in _BLURS
            ],
            axis=1,
        )
        hard = light[:, 0].max()
        self._law = RectBivariateSpline(steps, np.square(_BLURS), light / hard)
        self._most = float(steps[-1])

    def __call__(self, step: Array, blur2: float = 0.0, ripple2: float = 0.0) -> Array:
        """Light over what hard stripes send at most, of steps in radians.

        blur2: pixels², variance of the Gaussian. ripple2: variance of the phase within an
        exposure or a filter's band, as a share of the phase.
        """
        light = np.zeros(np.shape(step))
        for stretch, weight in _ripple_nodes(ripple2):
            light += weight * self._evaluate(step * stretch, blur2)
        return light

    def derivatives(self, step: Array, blur2: float, ripple2: float) -> tuple[Array, Array]:
        """Its derivatives with step and blur2."""
        by_step, by_blur = np.zeros(np.shape(step)), np.zeros(np.shape(step))
        for stretch, weight in _ripple_nodes(ripple2):
            by_step += (
                weight * stretch * self._evaluate(step * stretch, blur2, dx=1) * np.sign(step)
            )
            by_blur += weight * self._evaluate(step * stretch, blur2, dy=1)
        return by_step, by_blur

    def _evaluate(self, step: Array, blur2: float, dx: int = 0, dy: int = 0) -> Array:
        within = np.minimum(np.abs(step), self._most)
        return np.asarray(self._law.ev(within, np.full(within.shape, blur2), dx=dx, dy=dy))


def _ripple_nodes(ripple2: float) -> list[tuple[float, float]]:
    if ripple2 == 0:
        return [(1.0, 1.0)]
    return [(1 + node * math.sqrt(ripple2), weight) for node, weight in _GAUSS_HERMITE]


def _first_order_wave(shape: tuple[int, int], vector: Array) -> NDArray[np.complex128]:
    """exp(-2πi k·r) at pixels, under a window that ends softly, without a mean: what all of the
    panel sends straight on has no part in the first order."""
    fading = np.outer(*(np.hanning(n + 2)[1:-1] for n in shape))
    y, x = np.arange(shape[0])[:, None], np.arange(shape[1])[None, :]
    wave = np.exp(-2j * np.pi * (vector[0] * y + vector[1] * x))
    return fading * (wave - (fading * wave).sum() / fading.sum())


def _wave_by_height(
    patch: Array, wave: NDArray[np.complex128], vector: Array, blur: float, side: float
) -> NDArray[np.complex128]:
    """The first order's wave, summed over the points of each height, (heights,)."""
    total = np.zeros(_HEIGHTS, dtype=np.complex128)
    nodes = list(zip(_NODES * side / 2, _WEIGHTS / 2, strict=True))
    for dy, high in nodes:
        rows = _blur_axis(patch, blur, dy, 0)
        for dx, wide in nodes:
            height = np.clip(_blur_axis(rows, blur, dx, 1), 0, 1).ravel() * (_HEIGHTS - 1)
            below = np.minimum(height.astype(int), _HEIGHTS - 2)
            share = (height - below) * high * wide
            there = wave * np.exp(-2j * np.pi * (vector[0] * dy + vector[1] * dx))
            for number, weight in ((below, high * wide - share), (below + 1, share)):
                for part, unit in ((there.real, 1), (there.imag, 1j)):
                    total += unit * np.bincount(number, weight * part.ravel(), _HEIGHTS)
    return total


def _blur_axis(values: Array, blur: float, place: float, axis: int) -> Array:
    """A staircase of pixels, blurred by a Gaussian, at a place in every pixel; the outermost
    pixels are continued."""
    if blur == 0:
        return values
    reach = math.ceil(_REACH * blur) + 1
    edges = (np.arange(-reach, reach + 2) - 0.5 - place) / blur
    taps = np.diff(ndtr(edges))
    return correlate1d(values, taps / taps.sum(), axis=axis, mode="nearest")
