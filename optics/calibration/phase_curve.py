"""Model a panel's phase curve over grey levels, and the light that it sends into first orders."""

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

SWING, OFFSET, BLUR2, RIPPLE2, GHOST, FIRST_INCREMENT = range(6)
"""Indices of a phase curve's parameters; the increments follow from FIRST_INCREMENT on."""


@dataclass(frozen=True)
class PhaseCurveSettings:
    """Tune the fit of phase curves; all values are chosen.

    Attributes
    ----------
    no_ghost, some_ghost : float
        Expected standard deviations of the ghost, as shares of the swing, of a fit without and
        of one with a ghost.
    usual_blur2 : float
        Expected square of the blur, panel pixels squared.
    usual_ripple2 : float
        Expected square of the ripple, which is a share of the phase.
    most_ripple : float
        Upper bound of the ripple, as a share of the phase.
    most_ghost : float
        Bound of the ghost, as a share of the swing.
    difference_step : float
        Step of the squared ripple for its derivative by differences.
    steps : int
        Most evaluations of one least-squares fit.
    end_knot_density : float
        How much denser the spline's knots are at the ends, where a curve may bend most.
    """

    no_ghost: float = 1e-5
    some_ghost: float = 0.03
    usual_blur2: float = 0.5**2
    usual_ripple2: float = 0.02**2
    most_ripple: float = 0.08
    most_ghost: float = 0.3
    difference_step: float = 1e-8
    steps: int = 100
    end_knot_density: float = 0.35


SETTINGS = PhaseCurveSettings()


@dataclass(frozen=True, eq=False)
class PhaseCurve:
    """Model the light of a sweep as swing (law + ghost sin step) + offset of a phase spline.

    The step is the phase difference of a frame's two stripes. parameters: swing and offset of the
    light; squares of blur and ripple, in which the light is linear while they are small; the
    ghost, a share of the swing, which is the tail of the zeroth order that interferes with the
    first; and the spline's increments. top: the highest grey level. ghost_sigma: the expected
    ghost, `SETTINGS.no_ghost` or `SETTINGS.some_ghost`.
    """

    sweep: Sweep
    top: int
    parameters: Array
    ghost_sigma: float = SETTINGS.no_ghost

    @property
    def _prior_sigmas(self) -> dict[int, float]:
        """The prior standard deviations of the calibration fit's parameters, by index."""
        return {
            BLUR2: SETTINGS.usual_blur2,
            RIPPLE2: SETTINGS.usual_ripple2,
            GHOST: self.ghost_sigma,
        }

    @property
    def increments(self) -> Array:
        return self.parameters[FIRST_INCREMENT:]

    @property
    def increment_count(self) -> int:
        return len(self.increments)

    @property
    def phase_range(self) -> float:
        """The fitted phase of the calibration curve at the highest grey level, radians."""
        return float(self.increments.sum())

    @cached_property
    def basis(self) -> Array:
        """The derivative of each calibration frame's phase step by each increment, (n, count)."""
        low, high = (
            monotone_spline_basis(levels, self.top, self.increment_count)
            for levels in (self.sweep.low, self.sweep.high)
        )
        return high - low

    def predicted_light(self, parameters: Array | None = None) -> Array:
        """Predict the first-order light of each calibration frame from the phase curve, (n,)."""
        p = self.parameters if parameters is None else parameters
        return p[SWING] * self._relative_light(p) + p[OFFSET]

    def _relative_light(self, p: Array) -> Array:
        steps = self.basis @ p[FIRST_INCREMENT:]
        return self.sweep.law(steps, p[BLUR2], p[RIPPLE2]) + p[GHOST] * np.sin(steps)

    def residuals(self, parameters: Array) -> Array:
        """Compute the calibration fit's residuals in standard deviations, (n + 3,).

        The last three residuals belong to the priors.
        """
        misfit = (self.predicted_light(parameters) - self.sweep.light) / self.sweep.noise
        known = [parameters[k] / usual for k, usual in self._prior_sigmas.items()]
        return np.concatenate([misfit, known])

    def jacobian(self, parameters: Array) -> Array:
        """Compute the derivatives of the calibration fit's residuals, (n + 3, parameters)."""
        p, law, dr = parameters, self.sweep.law, SETTINGS.difference_step
        steps = self.basis @ p[FIRST_INCREMENT:]
        share = law(steps, p[BLUR2], p[RIPPLE2])
        by_step, by_blur = law.derivatives(steps, p[BLUR2], p[RIPPLE2])
        by_ripple = (law(steps, p[BLUR2], p[RIPPLE2] + dr) - share) / dr
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
        """The calibration fit's residuals without the priors, in standard deviations, (n,)."""
        return self.residuals(self.parameters)[: -len(self._prior_sigmas)]

    @property
    def cost(self) -> float:
        return float((self.residuals(self.parameters) ** 2).sum())

    @property
    def information_criterion(self) -> float:
        """The calibration fit's Bayesian information criterion; less is better.

        The criterion assumes noise of unknown scale.
        """
        n = len(self.sweep.light)
        return n * math.log(max(self.cost, 1e-3 * n) / n) + len(self.parameters) * math.log(n)

    def covariance(self, inliers: NDArray[np.bool_]) -> Array:
        """Compute the covariance of the calibration fit's parameters from inlier frames, (p, p).

        A parameter on a bound counts as free, so that the covariance isn't too small.
        """
        kept = np.concatenate([inliers, np.ones(len(self._prior_sigmas), dtype=bool)])
        jacobian = self.jacobian(self.parameters)[kept]
        return np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-12, hermitian=True)

    def with_fitted_swing(self) -> PhaseCurve:
        """Return the calibration curve with its linear parameters, swing and offset, fitted."""
        share = self._relative_light(self.parameters)
        design = np.column_stack([share, np.ones_like(share)]) / self.sweep.noise[:, None]
        lamp, *_ = np.linalg.lstsq(design, self.sweep.light / self.sweep.noise, rcond=None)
        return replace(self, parameters=np.concatenate([lamp, self.parameters[2:]]))

    def fit(self) -> PhaseCurve:
        """Fit the phase curve to its calibration sweep by least squares.

        The fit starts from the curve's own parameters.
        """
        lower = np.zeros_like(self.parameters)
        upper = np.full_like(self.parameters, np.inf)
        ghost = SETTINGS.most_ghost
        lower[OFFSET], lower[GHOST] = -np.inf, -ghost
        upper[[BLUR2, RIPPLE2, GHOST]] = MOST_BLUR**2, SETTINGS.most_ripple**2, ghost
        start = np.clip(self.parameters, lower + 1e-9, upper - 1e-9)
        found = least_squares(
            self.residuals,
            start,
            self.jacobian,
            bounds=(lower, upper),
            x_scale="jac",
            max_nfev=SETTINGS.steps,
        )
        return replace(self, parameters=found.x)

    def with_increments(self, count: int) -> PhaseCurve:
        """Return the same calibration curve with another number of spline increments."""
        fine = np.linspace(0, self.top, 8 * count)
        phase = monotone_spline_basis(fine, self.top, self.increment_count) @ self.increments
        basis = monotone_spline_basis(fine, self.top, count)
        increments, *_ = np.linalg.lstsq(basis, phase, rcond=None)
        start = np.concatenate([self.parameters[:FIRST_INCREMENT], np.clip(increments, 1e-4, None)])
        return replace(self, parameters=start)


def monotone_spline_basis(levels: Array | NDArray[np.int64], top: int, count: int) -> Array:
    """Compute the basis of a monotone phase spline for calibration fits, (levels, count).

    Each column is the change of the spline by one increment. The curve is 0 at level 0. It is a
    cubic spline over 0 to `top`, with denser knots at the ends. It rises if its coefficients rise
    (de Boor 1978), that is, if no increment is negative.
    """
    x = np.linspace(0, 1, count - 1)
    density = SETTINGS.end_knot_density
    inner = top * (x - density * np.sin(2 * math.pi * x) / (2 * math.pi))
    knots = np.concatenate([np.zeros(3), inner, np.full(3, float(top))])
    splines = BSpline.design_matrix(np.asarray(levels, dtype=np.float64), knots, 3).toarray()
    # An increment raises its own coefficient and all later ones.
    return np.cumsum(splines[:, ::-1], axis=1)[:, ::-1][:, 1:]
