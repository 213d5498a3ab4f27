"""The phase of every grey level, from the light that stripes send into their first order.

Stripes of two levels send sin²(half of the step between their phases) of what they can into
their first order. Over a sweep of levels that light comes and goes once a wave; a smooth, rising
phase is fitted to it, so that the waves are counted by the way. Where the light is at its most
or its least it hardly tells the phase: a second reference level, about a quarter of a wave from
the first, sees those places best.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.optimize import least_squares

from optics.calibration.stripes import MOST_BLUR, StripeLaw

Array = NDArray[np.float64]

_FEWEST = 12
"""Levels of a sweep from which a curve can be told."""

_COEFFICIENTS = (5, 7, 9, 11, 13, 15, 18)
"""Of the curve, tried in this order, each from the one before."""

_REACHES = np.linspace(0.6, 1.45, 35)
_GAMMAS = (0.6, 0.8, 1.0, 1.25, 1.6)
"""Starts: ranges over the expected one, and powers of the level."""

_KEPT, _FOLLOWED = 8, 3
"""Of the starts, that are tried; and of these, that are followed to finer curves."""

_USUAL_BLUR, _USUAL_RIPPLE = 0.5, 0.02
"""Of panel pixels, and of the phase: what is expected before the light tells."""

_ALIKE = 0.3
"""Radians at the highest level by which two coarse curves are the same."""

_MOST_RIPPLE = 0.08

_NUDGE = 1e-8
"""Of the square of the ripple, for its derivative by differences."""

_STEPS = 100

_OUTLYING = 5.0
_FAINTEST = 10.0
"""Times its noise that the light must come and go by."""

_BLURRED, _BLUR_DOUBT = 108.0, 0.05
"""Radians by which a blur of one period moves the light's turning points, times its square;
and how far a Gaussian may be wrong about it."""

_POOREST = 0.1
"""Of the swing, root mean square, beyond which a fit is none."""


@dataclass(frozen=True, eq=False)
class Sweep:
    """Light in one region's first orders, level by level.

    low, high: (n,) grey levels of the two stripes of each frame. light: (n,) in any unit.
    noise: (n,) its standard deviation. law: of the stripes that were shown. Raises ValueError
    for arrays that don't go together or hold no numbers.
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
        if len(set(self.high.tolist())) < _FEWEST:
            raise ValueError(
                f"the sweep has {len(set(self.high.tolist()))} levels; a curve needs "
                f"{_FEWEST} at least"
            )
        if not (np.isfinite(self.light).all() and (self.noise > 0).all()):
            raise ValueError("light must be finite and its noise positive")


@dataclass(frozen=True, eq=False)
class ResponseFit:
    """A fitted curve: phase less that of level 0, radians, of all levels (levels,).

    sigma: standard deviation of phase, (levels,). blur: of the phase by neighbours, panel
    pixels. ripple: of the phase within a frame, as a share of it. swing, offset: of the light.
    predicted: (n,) light that the fit expects of each frame. used: which frames decided; others
    were outliers. residual: root mean square of light less predicted, as a share of the swing.
    chi2: mean squared residual in standard deviations, less what was fitted. rival: by how much
    the information criterion of the best fit that counts the waves otherwise is larger; below 10
    the count is in doubt.
    """

    phase: Array
    sigma: Array
    blur: float
    ripple: float
    swing: float
    offset: float
    predicted: Array
    used: NDArray[np.bool_]
    residual: float
    chi2: float
    rival: float


def fit_response(sweep: Sweep, levels: int, expected: float) -> ResponseFit:
    """The phase of `levels` grey levels; expected: radians at the highest, as a data sheet says.

    A rising cubic spline whose increments aren't negative, with swing and offset of the light,
    neighbours' blur and ripple, by least squares in units of noise, from many starts (0.6 to
    1.45 times the expected range). The number of coefficients is the one with the smallest
    Bayesian information criterion. Frames farther than five deviations from the fit are left
    out once. Raises ValueError if the light doesn't come and go, or follows no such curve.
    """
    if not 0 < expected < math.inf:
        raise ValueError(f"expected is {expected:g} rad; it must be positive and finite")
    _require_swing(sweep)
    found = _fitted(sweep, levels, expected)
    best = found[0]
    away = np.abs(best.misfit) * sweep.noise / _scatter(best.misfit * sweep.noise, sweep.noise)
    used = away <= _OUTLYING
    if not used.all() and used.sum() >= _FEWEST:
        found = _fitted(_some(sweep, used), levels, expected)
        best = replace(found[0], sweep=sweep)
    else:
        used = np.ones(len(used), dtype=bool)
    return _told(best, used, levels, _rival(found))


def _require_swing(sweep: Sweep) -> None:
    low, high = np.percentile(sweep.light, [5, 95])
    if not high - low > _FAINTEST * np.median(sweep.noise):
        raise ValueError(
            f"the light in the first orders comes and goes by {high - low:.3g}, with a noise of "
            f"{np.median(sweep.noise):.3g}: too little to see the phase; expose longer, or check "
            "the polariser and that the panel shows the gratings"
        )


def _some(sweep: Sweep, used: NDArray[np.bool_]) -> Sweep:
    return Sweep(sweep.low[used], sweep.high[used], sweep.light[used], sweep.noise[used], sweep.law)


def _scatter(misses: Array, noise: Array) -> Array:
    """Standard deviation of a frame, at least that of its noise, by the median of all."""
    typical = 1.4826 * float(np.median(np.abs(misses / noise)))
    return noise * max(typical, 1.0)


@dataclass(frozen=True, eq=False)
class _Curve:
    """A model at work: parameters are swing, offset, the squares of blur and ripple, in which the
    light is linear while they are small, and the spline's increments."""

    sweep: Sweep
    top: int
    parameters: Array

    @property
    def increments(self) -> Array:
        return self.parameters[4:]

    @property
    def count(self) -> int:
        return len(self.increments)

    @cached_property
    def basis(self) -> Array:
        """What each increment adds to the step between a frame's stripes, (n, count)."""
        low, high = (
            rising_basis(levels, self.top, self.count)
            for levels in (self.sweep.low, self.sweep.high)
        )
        return high - low

    def steps(self, parameters: Array | None = None) -> Array:
        return self.basis @ (self.parameters if parameters is None else parameters)[4:]

    def light(self, parameters: Array | None = None) -> Array:
        p = self.parameters if parameters is None else parameters
        return p[0] * self.share(p) + p[1]

    def share(self, parameters: Array) -> Array:
        return self.sweep.law(self.steps(parameters), parameters[2], parameters[3])

    def residuals(self, parameters: Array) -> Array:
        """In standard deviations; the last two are what is expected of blur and ripple."""
        misfit = (self.light(parameters) - self.sweep.light) / self.sweep.noise
        known = (parameters[2] / _USUAL_BLUR**2, parameters[3] / _USUAL_RIPPLE**2)
        return np.concatenate([misfit, known])

    def jacobian(self, parameters: Array) -> Array:
        """Derivatives of the residuals, (n + 2, parameters)."""
        p = parameters
        steps, law = self.steps(p), self.sweep.law
        share = law(steps, p[2], p[3])
        by_step, by_blur = law.slopes(steps, p[2], p[3])
        by_ripple = (law(steps, p[2], p[3] + _NUDGE) - share) / _NUDGE
        columns = [share, np.ones_like(share), p[0] * by_blur, p[0] * by_ripple]
        found = np.column_stack([*columns, p[0] * by_step[:, None] * self.basis])
        known = np.zeros((2, len(p)))
        known[0, 2], known[1, 3] = _USUAL_BLUR**-2, _USUAL_RIPPLE**-2
        return np.concatenate([found / self.sweep.noise[:, None], known])

    @property
    def misfit(self) -> Array:
        return self.residuals(self.parameters)[:-2]

    @property
    def cost(self) -> float:
        return float((self.residuals(self.parameters) ** 2).sum())

    @property
    def reach(self) -> float:
        """Phase at the highest level, radians."""
        return float(self.increments.sum())

    @property
    def criterion(self) -> float:
        """Bayesian information of the fit, with the noise's scale unknown: smaller is better."""
        n = len(self.sweep.light)
        return n * math.log(max(self.cost, 1e-3 * n) / n) + len(self.parameters) * math.log(n)

    def with_lamp(self) -> _Curve:
        """With the swing and the offset that fit best; they are linear."""
        share = self.share(self.parameters)
        design = np.column_stack([share, np.ones_like(share)]) / self.sweep.noise[:, None]
        lamp, *_ = np.linalg.lstsq(design, self.sweep.light / self.sweep.noise, rcond=None)
        return replace(self, parameters=np.concatenate([lamp, self.parameters[2:]]))

    def solved(self) -> _Curve:
        lower = np.zeros_like(self.parameters)
        lower[1] = -np.inf
        upper = np.full_like(self.parameters, np.inf)
        upper[2:4] = MOST_BLUR**2, _MOST_RIPPLE**2
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

    def refined(self, count: int) -> _Curve:
        """The same curve with another number of increments."""
        fine = np.linspace(0, self.top, 8 * count)
        phase = rising_basis(fine, self.top, self.count) @ self.increments
        basis = rising_basis(fine, self.top, count)
        increments, *_ = np.linalg.lstsq(basis, phase, rcond=None)
        start = np.concatenate([self.parameters[:4], np.clip(increments, 1e-4, None)])
        return replace(self, parameters=start)


def rising_basis(levels: Array | NDArray[np.int64], top: int, count: int) -> Array:
    """What each of `count` increments adds to a curve from 0 at level 0, (levels, count).

    The curve is a cubic spline over 0 to `top`; coefficients that rise make it rise
    (de Boor 1978), so that increments which aren't negative do.
    """
    inner = np.linspace(0, top, count - 1)
    knots = np.concatenate([np.zeros(3), inner, np.full(3, float(top))])
    splines = BSpline.design_matrix(np.asarray(levels, dtype=np.float64), knots, 3).toarray()
    # An increment lifts its own coefficient and all behind it.
    return np.cumsum(splines[:, ::-1], axis=1)[:, ::-1][:, 1:]


def _fitted(sweep: Sweep, levels: int, expected: float) -> list[_Curve]:
    """Curves that fit, the best first; each of its own start, with its best size."""
    top = levels - 1
    found = []
    coarse = [start.solved() for start in _starts(sweep, top, expected)]
    for start in _different(sorted(coarse, key=lambda curve: curve.cost))[:_FOLLOWED]:
        tried = [start]
        for count in _COEFFICIENTS[1:]:
            if 4 + count > len(sweep.light) - 4:
                break
            tried.append(tried[-1].refined(count).solved())
        found.append(min(tried, key=lambda curve: curve.criterion))
    return sorted(found, key=lambda curve: curve.criterion)


def _different(curves: list[_Curve]) -> list[_Curve]:
    """Without those that ended where a better one did."""
    kept: list[_Curve] = []
    for curve in curves:
        if all(abs(curve.reach - other.reach) > _ALIKE for other in kept):
            kept.append(curve)
    return kept


def _starts(sweep: Sweep, top: int, expected: float) -> Iterable[_Curve]:
    """The most promising of many ranges and shapes, all of them different."""
    count = _COEFFICIENTS[0]
    fine = np.linspace(0, top, 200)
    basis = rising_basis(fine, top, count)
    tried = []
    for gamma in _GAMMAS:
        shape, *_ = np.linalg.lstsq(basis, (fine / top) ** gamma, rcond=None)
        shape = np.clip(shape, 1e-3, None)
        for reach in _REACHES:
            increments = reach * expected * shape / shape.sum()
            curve = _Curve(sweep, top, np.concatenate([[1, 0, 0.04, 1e-5], increments]))
            tried.append(curve.with_lamp())
    tried = [curve for curve in tried if curve.parameters[0] > 0] or tried
    return sorted(tried, key=lambda curve: curve.cost)[:_KEPT]


def _rival(found: list[_Curve]) -> float:
    """How much worse the best fit with another count of waves is."""
    best = found[0]
    others = [c.criterion for c in found if abs(c.reach - best.reach) > math.pi / 2]
    return min(others, default=math.inf) - best.criterion


def _told(best: _Curve, used: NDArray[np.bool_], levels: int, rival: float) -> ResponseFit:
    sweep, p = best.sweep, best.parameters
    predicted = best.light()
    misses = (sweep.light - predicted)[used]
    residual = float(np.sqrt((misses**2).mean())) / p[0]
    if not residual < _POOREST:
        raise ValueError(
            f"the light follows no rising phase: it is off by {residual:.0%} of its swing, root "
            "mean square; check that the lamp is steady and that the table of the panel's range "
            "is right to a third"
        )
    freedom = max(int(used.sum()) - len(p), 1)
    chi2 = float(((misses / sweep.noise[used]) ** 2).sum()) / freedom
    basis = rising_basis(np.arange(levels), levels - 1, best.count)
    covariance = _covariance(best, used) * max(chi2, 1.0)
    spread = basis @ covariance[4:, 4:]
    doubt = _BLUR_DOUBT * min(_BLURRED * p[2] / sweep.law.period**2, math.pi)
    return ResponseFit(
        phase=np.maximum.accumulate(basis @ best.increments),
        sigma=np.sqrt(np.clip((spread * basis).sum(1), 0, None) + doubt**2),
        blur=math.sqrt(p[2]),
        ripple=math.sqrt(p[3]),
        swing=float(p[0]),
        offset=float(p[1]),
        predicted=predicted,
        used=used,
        residual=residual,
        chi2=chi2,
        rival=rival,
    )


def _covariance(best: _Curve, used: NDArray[np.bool_]) -> Array:
    """Of the parameters, (p, p): from the fit's derivatives; what lies on a bound is taken as
    free, so that the answer isn't too sure."""
    jacobian = best.jacobian(best.parameters)
    jacobian = jacobian[np.concatenate([used, [True, True]])]
    return np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-12, hermitian=True)
