"""A panel's phase curve over grey levels, and what light stripes send into first orders."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, RectBivariateSpline
from scipy.ndimage import correlate1d
from scipy.optimize import least_squares
from scipy.special import ndtr

from optics.gauss_legendre import gauss_legendre
from optics.validation import require_positive

Array = NDArray[np.float64]

_MOST_BLUR = 1.5  # pixels: largest standard deviation of the blur; chosen
# Pixels: standard deviations at which the law is computed
_BLURS = (0.0, 0.1, 0.2, 0.3, 0.42, 0.55, 0.7, 0.85, 1.0, 1.25, _MOST_BLUR)
_NODES, _WEIGHTS = gauss_legendre(7)  # along an axis of a pixel's active area
_HEIGHTS = 257  # between the two levels, into which the blurred pattern is sorted; chosen
# Nodes, in standard deviations of the ripple, and their weights
_GAUSS_HERMITE = ((-math.sqrt(3.0), 1 / 6), (0.0, 2 / 3), (math.sqrt(3.0), 1 / 6))


class StripeLaw:
    """Computes the light in a grating's first order from phase step and blur by neighbours.

    upper: (rows, columns), where the pattern has the upper level; a part of the pattern represents
        the whole.
    vector: its grating vector, (y, x) cycles per pixel.
    active_side: side of the square of a pixel that modulates, in pixels.
    max_step: largest step in radians.

    Hard stripes send the share sin²(step / 2) of the largest possible light into each first order.
    The coupling of neighbouring pixels blurs the phase, which then takes all values between the two
    levels at the stripes' edges. The pattern is therefore blurred by a Gaussian, sampled in the
    active areas, and sorted by height, and the first order's wave is summed for each height. The
    light is relative to the most that hard stripes send.
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
        sums = (_wave_by_height(patch, wave, vector, blur, active_side) for blur in _BLURS)
        light = np.stack([np.abs(turned @ one) ** 2 for one in sums], axis=1)
        self._law = RectBivariateSpline(steps, np.square(_BLURS), light / light[:, 0].max())
        self._most = float(steps[-1])

    def __call__(self, step: Array, blur2: float = 0.0, ripple2: float = 0.0) -> Array:
        """Compute the first-order light of phase steps, relative to the most of hard stripes.

        step: radians.
        blur2: pixels², variance of the Gaussian.
        ripple2: variance of the phase within an exposure or a filter's band, as a share of the
            phase.
        """
        light = np.zeros(np.shape(step))
        for stretch, weight in _ripple_nodes(ripple2):
            light += weight * self._evaluate(step * stretch, blur2)
        return light

    def derivatives(self, step: Array, blur2: float, ripple2: float) -> tuple[Array, Array]:
        """Compute the derivatives of the light by step and by blur2."""
        by_step, by_blur = np.zeros(np.shape(step)), np.zeros(np.shape(step))
        for stretch, weight in _ripple_nodes(ripple2):
            along = self._evaluate(step * stretch, blur2, dx=1)
            by_step += weight * stretch * along * np.sign(step)
            by_blur += weight * self._evaluate(step * stretch, blur2, dy=1)
        return by_step, by_blur

    def _evaluate(self, step: Array, blur2: float, dx: int = 0, dy: int = 0) -> Array:
        within = np.minimum(np.abs(step), self._most)
        return np.asarray(self._law.ev(within, np.full(within.shape, blur2), dx=dx, dy=dy))


def _ripple_nodes(ripple2: float) -> list[tuple[float, float]]:
    """Return Gauss-Hermite nodes and weights over the ripple of the phase within a frame."""
    if ripple2 == 0:
        return [(1.0, 1.0)]
    return [(1 + node * math.sqrt(ripple2), weight) for node, weight in _GAUSS_HERMITE]


def _first_order_wave(shape: tuple[int, int], vector: Array) -> NDArray[np.complex128]:
    """Return the first-order wave exp(-2πi k·r) at the panel's pixels, times a tapered window.

    Its mean is subtracted, because a constant phase of the whole panel sends no light into the
    first order.
    """
    fading = np.outer(*(np.hanning(n + 2)[1:-1] for n in shape))
    y, x = np.arange(shape[0])[:, None], np.arange(shape[1])[None, :]
    wave = np.exp(-2j * np.pi * (vector[0] * y + vector[1] * x))
    return fading * (wave - (fading * wave).sum() / fading.sum())


def _wave_by_height(
    patch: Array, wave: NDArray[np.complex128], vector: Array, blur: float, side: float
) -> NDArray[np.complex128]:
    """Sum the first-order wave over the points of blurred stripes, by their height, (heights,)."""
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
    """Blur a staircase of pixels along an axis by a Gaussian, to one sample per pixel.

    place: of the sample in its pixel, in pixels from the centre. The outermost pixels are
    continued.
    """
    if blur == 0:
        return values
    # The Gaussian is negligible beyond five standard deviations.
    reach = math.ceil(5.0 * blur) + 1
    edges = (np.arange(-reach, reach + 2) - 0.5 - place) / blur
    taps = np.diff(ndtr(edges))
    return correlate1d(values, taps / taps.sum(), axis=axis, mode="nearest")


MIN_LEVELS = 12  # fewest levels of a sweep from which a phase curve can be fitted; chosen


@dataclass(frozen=True, eq=False)
class Sweep:
    """Light of one region's first orders in a sweep of grey levels, frame by frame.

    low, high: (n,) grey levels of the two stripes of each frame.
    light: (n,) in any unit.
    noise: (n,) standard deviation of the light.
    law: that of the displayed stripes.

    Raises ValueError for arrays of different shapes, for too few levels, and for light or noise
    that isn't valid.
    """

    low: NDArray[np.int64]
    high: NDArray[np.int64]
    light: Array
    noise: Array
    law: StripeLaw

    def __post_init__(self) -> None:
        given = (self.low, self.high, self.light, self.noise)
        if len({array.shape for array in given}) > 1 or self.low.ndim != 1:
            raise ValueError(
                f"low, high, light and noise are {', '.join(str(a.shape) for a in given)}; give "
                "one value a frame of each"
            )
        levels = len(set(self.high.tolist()))
        if levels < MIN_LEVELS:
            raise ValueError(f"the sweep has {levels} levels; a curve needs {MIN_LEVELS} at least")
        if not (np.isfinite(self.light).all() and (self.noise > 0).all()):
            raise ValueError("light must be finite and its noise positive")

    def select(self, inliers: NDArray[np.bool_]) -> Sweep:
        """Return the sweep with its inlier frames only."""
        low, high, light, noise = self.low, self.high, self.light, self.noise
        return Sweep(low[inliers], high[inliers], light[inliers], noise[inliers], self.law)


SWING, OFFSET, BLUR2, RIPPLE2, GHOST, FIRST_INCREMENT = range(6)
"""Indices of a phase curve's parameters; the increments follow from FIRST_INCREMENT on."""


# The ghost's expected deviations and bound over the swing; chosen
NO_GHOST, SOME_GHOST, _MOST_GHOST = 1e-5, 0.03, 0.3
# Panel pixels², shares of the phase; chosen
_USUAL_BLUR2, _USUAL_RIPPLE2, _MOST_RIPPLE = 0.5**2, 0.02**2, 0.08
_DIFFERENCE_STEP = 1e-8  # of the squared ripple, for its derivative
_STEPS = 100  # evaluations of one least-squares fit at most; chosen
# More knots of the spline at the ends, where a curve may bend most; chosen
_END_KNOT_DENSITY = 0.35


@dataclass(frozen=True, eq=False)
class PhaseCurve:
    """The light of a sweep as swing (law + ghost sin step) + offset of a phase spline.

    The step is the phase difference of a frame's two stripes.

    top: the highest grey level.
    parameters: swing and offset of the light; squares of blur and ripple, in which the light is
        linear while they are small; the ghost, a share of the swing, which is the tail of the
        zeroth order that interferes with the first; and the spline's increments.
    ghost_sigma: the expected ghost, `NO_GHOST` or `SOME_GHOST`.
    """

    sweep: Sweep
    top: int
    parameters: Array
    ghost_sigma: float = NO_GHOST

    @property
    def _prior_sigmas(self) -> dict[int, float]:
        """The prior standard deviations of parameters, by index."""
        return {BLUR2: _USUAL_BLUR2, RIPPLE2: _USUAL_RIPPLE2, GHOST: self.ghost_sigma}

    @property
    def increments(self) -> Array:
        return self.parameters[FIRST_INCREMENT:]

    @property
    def phase_range(self) -> float:
        """The phase at the highest grey level, radians."""
        return float(self.increments.sum())

    @cached_property
    def basis(self) -> Array:
        """The derivative of each frame's phase step by each increment, (n, count)."""
        low, high = (
            monotone_spline_basis(levels, self.top, len(self.increments))
            for levels in (self.sweep.low, self.sweep.high)
        )
        return high - low

    def predicted_light(self, parameters: Array | None = None) -> Array:
        """Predict the first-order light of each frame, (n,)."""
        p = self.parameters if parameters is None else parameters
        return p[SWING] * self._relative_light(p) + p[OFFSET]

    def _relative_light(self, p: Array) -> Array:
        steps = self.basis @ p[FIRST_INCREMENT:]
        return self.sweep.law(steps, p[BLUR2], p[RIPPLE2]) + p[GHOST] * np.sin(steps)

    def residuals(self, parameters: Array) -> Array:
        """Compute the residuals in standard deviations, (n + 3,), the last three of the priors."""
        misfit = (self.predicted_light(parameters) - self.sweep.light) / self.sweep.noise
        known = [parameters[k] / usual for k, usual in self._prior_sigmas.items()]
        return np.concatenate([misfit, known])

    def jacobian(self, parameters: Array) -> Array:
        """Compute the derivatives of the residuals, (n + 3, parameters)."""
        p, law, dr = parameters, self.sweep.law, _DIFFERENCE_STEP
        steps = self.basis @ p[FIRST_INCREMENT:]
        share = law(steps, p[BLUR2], p[RIPPLE2])
        by_step, by_blur = law.derivatives(steps, p[BLUR2], p[RIPPLE2])
        by_ripple = (law(steps, p[BLUR2], p[RIPPLE2] + dr) - share) / dr
        turn = by_step + p[GHOST] * np.cos(steps)
        lead = [share + p[GHOST] * np.sin(steps), np.ones_like(share)]
        lead += [p[SWING] * column for column in (by_blur, by_ripple, np.sin(steps))]
        found = np.column_stack([*lead, p[SWING] * turn[:, None] * self.basis])
        priors = self._prior_sigmas
        known = np.zeros((len(priors), len(p)))
        known[range(len(priors)), list(priors)] = [1 / usual for usual in priors.values()]
        return np.concatenate([found / self.sweep.noise[:, None], known])

    @cached_property
    def cost(self) -> float:
        """The sum of the squared residuals, those of the priors included."""
        return float((self.residuals(self.parameters) ** 2).sum())

    @property
    def information_criterion(self) -> float:
        """The Bayesian information criterion, for noise of unknown scale; less is better."""
        n = len(self.sweep.light)
        return n * math.log(max(self.cost, 1e-3 * n) / n) + len(self.parameters) * math.log(n)

    def with_fitted_swing(self) -> PhaseCurve:
        """Return the curve with its linear parameters, swing and offset, fitted."""
        share = self._relative_light(self.parameters)
        design = np.column_stack([share, np.ones_like(share)]) / self.sweep.noise[:, None]
        lamp, *_ = np.linalg.lstsq(design, self.sweep.light / self.sweep.noise, rcond=None)
        return replace(self, parameters=np.concatenate([lamp, self.parameters[2:]]))

    def fit(self) -> PhaseCurve:
        """Fit the curve to its sweep by least squares, from its own parameters on."""
        lower = np.zeros_like(self.parameters)
        upper = np.full_like(self.parameters, np.inf)
        lower[OFFSET], lower[GHOST] = -np.inf, -_MOST_GHOST
        upper[[BLUR2, RIPPLE2, GHOST]] = _MOST_BLUR**2, _MOST_RIPPLE**2, _MOST_GHOST
        start = np.clip(self.parameters, lower + 1e-9, upper - 1e-9)
        found = least_squares(
            self.residuals, start, self.jacobian, (lower, upper), x_scale="jac", max_nfev=_STEPS
        )
        return replace(self, parameters=found.x)

    def with_increments(self, count: int) -> PhaseCurve:
        """Return the same curve with another number of spline increments."""
        fine = np.linspace(0, self.top, 8 * count)
        phase = monotone_spline_basis(fine, self.top, len(self.increments)) @ self.increments
        basis = monotone_spline_basis(fine, self.top, count)
        increments, *_ = np.linalg.lstsq(basis, phase, rcond=None)
        start = np.concatenate([self.parameters[:FIRST_INCREMENT], np.clip(increments, 1e-4, None)])
        return replace(self, parameters=start)


def monotone_spline_basis(levels: Array | NDArray[np.int64], top: int, count: int) -> Array:
    """Compute the basis of a monotone phase spline, (levels, count).

    Each column is the change of the spline by one increment. The curve is 0 at level 0. It is a
    cubic spline over 0 to `top`, with denser knots at the ends. It rises if its coefficients rise
    (de Boor 1978), that is, if no increment is negative.
    """
    x = np.linspace(0, 1, count - 1)
    inner = top * (x - _END_KNOT_DENSITY * np.sin(2 * math.pi * x) / (2 * math.pi))
    knots = np.concatenate([np.zeros(3), inner, np.full(3, float(top))])
    splines = BSpline.design_matrix(np.asarray(levels, dtype=np.float64), knots, 3).toarray()
    # An increment raises its own coefficient and all later ones.
    return np.cumsum(splines[:, ::-1], axis=1)[:, ::-1][:, 1:]
