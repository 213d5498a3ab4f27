"""Compute how much light a grating of two-level stripes sends into its first order."""

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
"""Largest standard deviation of the blur, in pixels, for which the law is computed; chosen."""

_BLURS = (0.0, 0.1, 0.2, 0.3, 0.42, 0.55, 0.7, 0.85, 1.0, 1.25, MOST_BLUR)
"""Standard deviations of the blur, in pixels, at which the law is computed."""

_NODES, _WEIGHTS = gauss_legendre(7)
"""Nodes along an axis of a pixel's active area at which the phase is evaluated."""

_HEIGHTS = 257
"""Number of heights between the two levels into which the blurred pattern is sorted; chosen."""

_GAUSS_HERMITE = ((-math.sqrt(3.0), 1 / 6), (0.0, 2 / 3), (math.sqrt(3.0), 1 / 6))
"""Gauss-Hermite nodes, in standard deviations of the ripple, and their weights."""


class StripeLaw:
    """Compute the light in a grating's first order from phase step and blur by neighbours.

    upper: (rows, columns), where the pattern has the upper level; a part of the pattern represents
    the whole. vector: its grating vector, (y, x) cycles per pixel. active_side: side of the square
    of a pixel that modulates, in pixels. max_step: largest step in radians.

    Hard stripes send the share sin²(step / 2) of the largest possible light into each first order.
    The coupling of neighbouring pixels blurs the phase, which then takes all values between the
    two levels at the stripes' edges. The pattern is therefore blurred by a Gaussian, sampled in
    the active areas, and sorted by height, and the first order's wave is summed for each height.
    The light is relative to the most that hard stripes send.
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
        # A part of 160 x 160 pixels represents the whole pattern.
        patch = upper[:160, :160].astype(np.float64)
        wave = _first_order_wave(patch.shape, vector)
        spacing = 0.05  # The law is a spline between steps that are 0.05 radians apart.
        steps = np.arange(0, max_step + 2 * spacing, spacing)
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
        """Compute the first-order light of phase steps, relative to the most of hard stripes.

        step: radians.

        blur2: pixels², variance of the Gaussian. ripple2: variance of the phase within an
        exposure or a filter's band, as a share of the phase.
        """
        light = np.zeros(np.shape(step))
        for stretch, weight in _ripple_nodes(ripple2):
            light += weight * self._evaluate(step * stretch, blur2)
        return light

    def derivatives(self, step: Array, blur2: float, ripple2: float) -> tuple[Array, Array]:
        """Compute derivatives of a calibration grating's first-order light by step and blur2."""
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
    """Return Gauss-Hermite nodes and weights over the ripple of a calibration frame's phase."""
    if ripple2 == 0:
        return [(1.0, 1.0)]
    return [(1 + node * math.sqrt(ripple2), weight) for node, weight in _GAUSS_HERMITE]


def _first_order_wave(shape: tuple[int, int], vector: Array) -> NDArray[np.complex128]:
    """Return a calibration grating's first-order wave exp(-2πi k·r) at the panel's pixels.

    The wave is multiplied by a tapered window. Its mean is subtracted, because a constant phase of
    the whole panel sends no light into the first order.
    """
    fading = np.outer(*(np.hanning(n + 2)[1:-1] for n in shape))
    y, x = np.arange(shape[0])[:, None], np.arange(shape[1])[None, :]
    wave = np.exp(-2j * np.pi * (vector[0] * y + vector[1] * x))
    return fading * (wave - (fading * wave).sum() / fading.sum())


def _wave_by_height(
    patch: Array, wave: NDArray[np.complex128], vector: Array, blur: float, side: float
) -> NDArray[np.complex128]:
    """Sum the first-order wave over a blurred calibration grating's points, by their height.

    The result has one sum per height, (heights,).
    """
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
    """Blur a calibration grating's pixel staircase along an axis by a Gaussian.

    The result has one sample per pixel. place: the position of the sample in its pixel, in pixels
    from the centre. The outermost pixels are continued.
    """
    if blur == 0:
        return values
    # The Gaussian is negligible beyond five standard deviations.
    reach = math.ceil(5.0 * blur) + 1
    edges = (np.arange(-reach, reach + 2) - 0.5 - place) / blur
    taps = np.diff(ndtr(edges))
    return correlate1d(values, taps / taps.sum(), axis=axis, mode="nearest")
