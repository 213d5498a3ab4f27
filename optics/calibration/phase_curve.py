"""A rising curve of phase over grey levels, and the light that it sends into first orders."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.optimize import least_squares

from optics.calibration.stripe_law import MOST_BLUR
from optics.calibration.sweep import Sweep

Array = NDArray[np.float64]

SWING, OFFSET, BLUR2, RIPPLE2, GHOST = range(5)
"""The first parameters of a curve, before its increments."""

FIRST_INCREMENT = 5

NO_GHOST, SOME_GHOST = 1e-5, 0.03
"""Of the swing, that a ghost is expected to have."""

_USUAL_BLUR2, _USUAL_RIPPLE2 = 0.5**2, 0.02**2
"""Of panel pixels, and of the phase, squared: what is expected before the light tells."""

_MOST_RIPPLE = 0.08
_MOST_GHOST = 0.3

_DIFFERENCE_STEP = 1e-8
"""Of the square of the ripple, for its derivative by differences."""

_STEPS = 100

_END_KNOT_DENSITY = 0.35
"""By how much a curve's knots are denser at the ends, where it may bend most."""


@dataclass(frozen=True, eq=False)
class PhaseCurve:
    """A model at work: swing (law + ghost sin step) + offset, over the steps of a spline.

    parameters: swing and offset of the light; squares of blur and ripple, in which the light is
    linear while they are small; the ghost, a share of the swing, which is the tail of the zeroth
    order that interferes with the first; and the spline's increments. top: the highest level.
    ghost_sigma: the ghost that is expected, NO_GHOST or SOME_GHOST.
    """

    sweep: Sweep
    top: int
    parameters: Array
    ghost_sigma: float = NO_GHOST

    @property
    def _prior_sigmas(self) -> dict[int, float]:
        """Standard deviations of what is expected beforehand, by parameter."""
        return {BLUR2: _USUAL_BLUR2, RIPPLE2: _USUAL_RIPPLE2, GHOST: self.ghost_sigma}

    @property
    def increments(self) -> Array:
        return self.parameters[FIRST_INCREMENT:]

    @property
    def increment_count(self) -> int:
        return len(self.increments)

    @property
    def phase_range(self) -> float:
        """Phase at the highest level, radians."""
        return float(self.increments.sum())

    @cached_property
    def basis(self) -> Array:
        """What each increment adds to the step between a frame's stripes, (n, count)."""
        low, high = (
            monotone_spline_basis(levels, self.top, self.increment_count)
            for levels in (self.sweep.low, self.sweep.high)
        )
        return high - low

    def predicted_light(self, parameters: Array | None = None) -> Array:
        """What each frame's first orders get, (n,)."""
        p = self.parameters if parameters is None else parameters
        return p[SWING] * self._relative_light(p) + p[OFFSET]

    def _relative_light(self, p: Array) -> Array:
        steps = self.basis @ p[FIRST_INCREMENT:]
        return self.sweep.law(steps, p[BLUR2], p[RIPPLE2]) + p[GHOST] * np.sin(steps)

    def residuals(self, parameters: Array) -> Array:
        """In standard deviations, (n + 3,); the last ones are what is expected beforehand."""
        misfit = (self.predicted_light(parameters) - self.sweep.light) / self.sweep.noise
        known = [parameters[k] / usual for k, usual in self._prior_sigmas.items()]
        return np.concatenate([misfit, known])

    def jacobian(self, parameters: Array) -> Array:
        """Derivatives of the residuals, (n + 3, parameters)."""
        p, law = parameters, self.sweep.law
        steps = self.basis @ p[FIRST_INCREMENT:]
        share = law(steps, p[BLUR2], p[RIPPLE2])
        by_step, by_blur = law.derivatives(steps, p[BLUR2], p[RIPPLE2])
        by_ripple = (law(steps, p[BLUR2], p[RIPPLE2] + _DIFFERENCE_STEP) - share) / _DIFFERENCE_STEP
        turn = by_step + p[GHOST] * np.cos(steps)
        lead = [share + p[GHOST] * np.sin(steps), np.ones_like(share)]
        lead += [p[SWING] * column for column in (by_blur, by_ripple, np.sin(steps))]
        found = np.column_stack([*lead, p[SWING] * turn[:, None] * self.basis])
        known = np.zeros((len(self._prior_sigmas), len(p)))
        for row, (k, usual) in enumerate(self._prior_sigmas.items()):
            known[row, k] = 1 / usual
        return np.concatenate([found / self.sweep.noise[:, None], known])

    @property
    def misfit(self) -> Array:
        """Of the light, in standard deviations, (n,)."""
        return self.residuals(self.parameters)[: -len(self._prior_sigmas)]

    @property
    def cost(self) -> float:
        return float((self.residuals(self.parameters) ** 2).sum())

    @property
    def information_criterion(self) -> float:
        """Bayesian information of the fit, with the noise's scale unknown: smaller is better."""
        n = len(self.sweep.light)
        return n * math.log(max(self.cost, 1e-3 * n) / n) + len(self.parameters) * math.log(n)

    def covariance(self, inliers: NDArray[np.bool_]) -> Array:
        """Of the parameters, (p, p), from some frames; what lies on a bound is taken as free, so
        that the answer isn't too sure."""
        kept = np.concatenate([inliers, np.ones(len(self._prior_sigmas), dtype=bool)])
        jacobian = self.jacobian(self.parameters)[kept]
        return np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-12, hermitian=True)

    def with_fitted_swing(self) -> PhaseCurve:
        """With the swing and the offset that fit best; they are linear."""
        share = self._relative_light(self.parameters)
        design = np.column_stack([share, np.ones_like(share)]) / self.sweep.noise[:, None]
        lamp, *_ = np.linalg.lstsq(design, self.sweep.light / self.sweep.noise, rcond=None)
        return replace(self, parameters=np.concatenate([lamp, self.parameters[2:]]))

    def fit(self) -> PhaseCurve:
        """The nearest curve that fits best, by least squares within bounds."""
        lower = np.zeros_like(self.parameters)
        upper = np.full_like(self.parameters, np.inf)
        lower[OFFSET], lower[GHOST] = -np.inf, -_MOST_GHOST
        upper[[BLUR2, RIPPLE2, GHOST]] = MOST_BLUR**2, _MOST_RIPPLE**2, _MOST_GHOST
        start = np.clip(self.parameters, lower + 1e-9, upper - 1e-9)
        found = least_squares(
            self.residuals,
            start,
            self.jacobian,
            bounds=(lower, upper),
            x_scale="jac",
            max_nfev=_STEPS,
        )
        return replace(self, parameters=found.x)

    def with_increments(self, count: int) -> PhaseCurve:
        """The same curve with another number of increments."""
        fine = np.linspace(0, self.top, 8 * count)
        phase = monotone_spline_basis(fine, self.top, self.increment_count) @ self.increments
        basis = monotone_spline_basis(fine, self.top, count)
        increments, *_ = np.linalg.lstsq(basis, phase, rcond=None)
        start = np.concatenate([self.parameters[:FIRST_INCREMENT], np.clip(increments, 1e-4, None)])
        return replace(self, parameters=start)


def monotone_spline_basis(levels: Array | NDArray[np.int64], top: int, count: int) -> Array:
    """What each of `count` increments adds to a curve from 0 at level 0, (levels, count).

    The curve is a cubic spline over 0 to `top`, with denser knots at the ends. Coefficients that
    rise make it rise (de Boor 1978), so that increments which aren't negative do.
    """
    x = np.linspace(0, 1, count - 1)
    inner = top * (x - _END_KNOT_DENSITY * np.sin(2 * math.pi * x) / (2 * math.pi))
    knots = np.concatenate([np.zeros(3), inner, np.full(3, float(top))])
    splines = BSpline.design_matrix(np.asarray(levels, dtype=np.float64), knots, 3).toarray()
    # An increment lifts its own coefficient and all behind it.
    return np.cumsum(splines[:, ::-1], axis=1)[:, ::-1][:, 1:]
