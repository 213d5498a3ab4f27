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

import numpy as np
from numpy.typing import NDArray

from optics.calibration.phase_curve import (
    BLUR2,
    FIRST_INCREMENT,
    GHOST,
    OFFSET,
    RIPPLE2,
    SOME_GHOST,
    SWING,
    PhaseCurve,
    monotone_spline_basis,
)
from optics.calibration.sweep import MIN_LEVELS, Sweep

Array = NDArray[np.float64]

_INCREMENT_COUNTS = (5, 7, 9, 11, 13, 15, 18)
"""Of the curve, tried in this order, each from the one before."""

_TRIAL_RANGES = np.linspace(0.6, 1.45, 35)
_GAMMAS = (0.6, 0.8, 1.0, 1.25, 1.6)
"""Starts: ranges over the expected one, and powers of the level."""

_GHOST_MARGIN = 16.0
"""Of the information criterion, by which a ghost must make the fit better to be believed in."""

_FIRST_BLUR2, _FIRST_RIPPLE2 = 0.04, 1e-5

_STARTS_FITTED, _STARTS_REFINED = 8, 3
"""Of the starts, that are tried; and of these, that are followed to finer curves."""

_SAME_RANGE = 0.3
"""Radians at the highest level by which two coarse curves are the same."""

_OUTLIER_SIGMAS = 5.0
_MIN_SWING_TO_NOISE = 10.0
"""Times its noise that the light must come and go by."""

_BLUR_PHASE_ERROR, _BLUR_UNCERTAINTY = 108.0, 0.05
"""Radians by which a blur of one period moves the light's turning points, times its square;
and how far a Gaussian may be wrong about it."""

_MAX_RESIDUAL = 0.1
"""Of the swing, root mean square, beyond which a fit is none."""


@dataclass(frozen=True, eq=False)
class ResponseFit:
    """A fitted curve: phase less that of level 0, radians, of all levels (levels,).

    sigma: standard deviation of phase, (levels,). blur: of the phase by neighbours, panel
    pixels. ripple: of the phase within a frame, as a share of it. swing, offset: of the light.
    ghost: light of the zeroth order that interferes, as a share of the swing.
    predicted: (n,) light that the fit expects of each frame. inliers: which frames decided; others
    were outliers. residual: root mean square of light less `predicted`, as a share of the swing.
    chi2: mean squared residual in standard deviations, less what was fitted. rival_margin: by how
    much the information criterion of the best fit that counts the waves otherwise is larger; below
    10 the count is in doubt.
    """

    phase: Array
    sigma: Array
    blur: float
    ripple: float
    swing: float
    offset: float
    ghost: float
    predicted: Array
    inliers: NDArray[np.bool_]
    residual: float
    chi2: float
    rival_margin: float


def fit_response(sweep: Sweep, levels: int, expected_range: float) -> ResponseFit:
    """The phase of `levels` grey levels.

    expected_range: radians at the highest level, as a data sheet says.

    A rising cubic spline whose increments aren't negative, with swing and offset of the light,
    neighbours' blur, ripple and, where it is plain to see, a ghost, by least squares in units of
    noise, from many starts (0.6 to 1.45 times the expected range). The number of coefficients is
    the one with the smallest Bayesian information criterion. Frames farther than five deviations
    from the fit are left out once. Raises ValueError if the light doesn't come and go, or follows
    no such curve.
    """
    if not 0 < expected_range < math.inf:
        raise ValueError(
            f"expected_range is {expected_range:g} rad; it must be positive and finite"
        )
    _require_swing(sweep)
    found = _fit_curves(sweep, levels, expected_range)
    best = found[0]
    away = np.abs(best.misfit) * sweep.noise / _scatter(best.misfit * sweep.noise, sweep.noise)
    used = away <= _OUTLIER_SIGMAS
    if not used.all() and used.sum() >= MIN_LEVELS:
        found = _fit_curves(sweep.select(used), levels, expected_range)
        best = replace(found[0], sweep=sweep)
    else:
        used = np.ones(len(used), dtype=bool)
    return _build_response_fit(best, used, levels, _rival_margin(found))


def _require_swing(sweep: Sweep) -> None:
    low, high = np.percentile(sweep.light, [5, 95])
    if not high - low > _MIN_SWING_TO_NOISE * np.median(sweep.noise):
        raise ValueError(
            f"the light in the first orders comes and goes by {high - low:.3g}, with a noise of "
            f"{np.median(sweep.noise):.3g}: too little to see the phase; expose longer, or check "
            "the polariser and that the panel shows the gratings"
        )


def _scatter(misses: Array, noise: Array) -> Array:
    """Standard deviation of a frame, at least that of its noise, by the median of all."""
    typical = 1.4826 * float(np.median(np.abs(misses / noise)))
    return noise * max(typical, 1.0)


def _fit_curves(sweep: Sweep, levels: int, expected_range: float) -> list[PhaseCurve]:
    """Curves that fit, the best first; each of its own start, with its best size."""
    top = levels - 1
    found: list[PhaseCurve] = []
    coarse = [start.fit() for start in _starts(sweep, top, expected_range)]
    for start in _distinct_curves(sorted(coarse, key=lambda curve: curve.cost))[:_STARTS_REFINED]:
        tried = [start]
        for count in _INCREMENT_COUNTS[1:]:
            if FIRST_INCREMENT + count > len(sweep.light) - 4:
                break
            tried.append(tried[-1].with_increments(count).fit())
        found.append(min(tried, key=lambda curve: curve.information_criterion))
    best = min(found, key=lambda curve: curve.information_criterion)
    haunted = replace(best, ghost_sigma=SOME_GHOST).fit()
    if haunted.information_criterion < best.information_criterion - _GHOST_MARGIN:
        found.append(haunted)
    return sorted(found, key=lambda curve: curve.information_criterion)


def _distinct_curves(curves: list[PhaseCurve]) -> list[PhaseCurve]:
    """Without those that ended where a better one did."""
    kept: list[PhaseCurve] = []
    for curve in curves:
        if all(abs(curve.phase_range - other.phase_range) > _SAME_RANGE for other in kept):
            kept.append(curve)
    return kept


def _starts(sweep: Sweep, top: int, expected_range: float) -> Iterable[PhaseCurve]:
    """The most promising of many ranges and shapes, all of them different."""
    count = _INCREMENT_COUNTS[0]
    fine = np.linspace(0, top, 200)
    basis = monotone_spline_basis(fine, top, count)
    lead = [1, 0, _FIRST_BLUR2, _FIRST_RIPPLE2, 0]
    tried = []
    for gamma in _GAMMAS:
        shape, *_ = np.linalg.lstsq(basis, (fine / top) ** gamma, rcond=None)
        shape = np.clip(shape, 1e-3, None)
        for reach in _TRIAL_RANGES:
            increments = reach * expected_range * shape / shape.sum()
            curve = PhaseCurve(sweep, top, np.concatenate([lead, increments]))
            tried.append(curve.with_fitted_swing())
    tried = [curve for curve in tried if curve.parameters[SWING] > 0] or tried
    return sorted(tried, key=lambda curve: curve.cost)[:_STARTS_FITTED]


def _rival_margin(curves: list[PhaseCurve]) -> float:
    """How much worse the best fit with another count of waves is."""
    best = curves[0]
    others = [
        c.information_criterion
        for c in curves
        if abs(c.phase_range - best.phase_range) > math.pi / 2
    ]
    return min(others, default=math.inf) - best.information_criterion


def _build_response_fit(
    best: PhaseCurve, inliers: NDArray[np.bool_], levels: int, rival: float
) -> ResponseFit:
    sweep, p = best.sweep, best.parameters
    predicted = best.predicted_light()
    misses = (sweep.light - predicted)[inliers]
    residual = float(np.sqrt((misses**2).mean())) / p[SWING]
    if not residual < _MAX_RESIDUAL:
        raise ValueError(
            f"the light follows no rising phase: it is off by {residual:.0%} of its swing, root "
            "mean square; check that the lamp is steady and that the table of the panel's range "
            "is right to a third"
        )
    freedom = max(int(inliers.sum()) - len(p), 1)
    chi2 = float(((misses / sweep.noise[inliers]) ** 2).sum()) / freedom
    basis = monotone_spline_basis(np.arange(levels), levels - 1, best.increment_count)
    covariance = best.covariance(inliers) * max(chi2, 1.0)
    spread = basis @ covariance[FIRST_INCREMENT:, FIRST_INCREMENT:]
    # A ghost moves all phases by twice its share; half of that is not believed.
    blurred = _BLUR_UNCERTAINTY * min(_BLUR_PHASE_ERROR * p[BLUR2] / sweep.law.period**2, math.pi)
    doubt = math.hypot(blurred, p[GHOST])
    return ResponseFit(
        phase=np.maximum.accumulate(basis @ best.increments),
        sigma=np.sqrt(np.clip((spread * basis).sum(1), 0, None) + doubt**2),
        blur=math.sqrt(p[BLUR2]),
        ripple=math.sqrt(p[RIPPLE2]),
        swing=float(p[SWING]),
        offset=float(p[OFFSET]),
        ghost=float(p[GHOST]),
        predicted=predicted,
        inliers=inliers,
        residual=residual,
        chi2=chi2,
        rival_margin=rival,
    )
