"""The phase response over grey levels, from the light in the first orders of stripe patterns.

Stripes of two levels send the share sin²(step / 2) of the largest possible light into their first
order, where step is the difference of their phases. Over a sweep of levels this light rises and
falls once per wave. A smooth, rising phase is fitted to it, which also counts the waves. Near the
light's maxima and minima it hardly depends on the phase. A second reference level, about a quarter
of a wave from the first, is most sensitive at these levels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from optics.measuring.phase_curve import (
    BLUR2,
    FIRST_INCREMENT,
    GHOST,
    MIN_LEVELS,
    OFFSET,
    RIPPLE2,
    SOME_GHOST,
    SWING,
    PhaseCurve,
    Sweep,
    monotone_spline_basis,
)

Array = NDArray[np.float64]


# Of the spline, each from the fit before; all are chosen
_INCREMENT_COUNTS = (5, 7, 9, 11, 13, 15, 18)
_GAMMAS = (0.6, 0.8, 1.0, 1.25, 1.6)  # exponents of the level in the starting curves
# Starting values, panel pixels² and share of the phase, squared
_FIRST_BLUR2, _FIRST_RIPPLE2 = 0.04, 1e-5
# Starting curves that are fitted, and refined with more increments
_STARTS_FITTED, _STARTS_REFINED = 8, 3
_SAME_RANGE = 0.3  # radians at the highest level within which two coarse curves count as the same
_GHOST_MARGIN = 16.0  # improvement of the information criterion from which a ghost is accepted
_OUTLIER_SIGMAS = 5.0  # standard deviations beyond which a frame is an outlier
# Of the light over its noise; root mean square over the swing
_MIN_SWING_TO_NOISE, _MAX_RESIDUAL = 10.0, 0.1
# Radians by which blur moves turning points, per square of blur over period
_BLUR_PHASE_ERROR = 108.0
_BLUR_UNCERTAINTY = 0.05  # relative, of that shift: the blur needn't be a Gaussian
_TRIAL_RANGES = np.linspace(0.6, 1.45, 35)  # of the starting curves, over the expected range


@dataclass(frozen=True, eq=False)
class ResponseFit:
    """A fitted phase response, in radians relative to level 0, (levels,).

    sigma: standard deviation of the phase, (levels,).
    blur: standard deviation of the phase's blur by neighbouring pixels, panel pixels.
    ripple: that of the phase within a frame, as a share of the phase.
    swing, offset: amplitude and offset of the light.
    ghost: light of the zeroth order that interferes, as a share of the swing.
    predicted: (n,) light of each frame according to the fit.
    inliers: which frames were used; the others are outliers.
    residual: root mean square of light less `predicted`, as a share of the swing.
    chi2: mean squared residual in standard deviations, per degree of freedom.
    rival_margin: information criterion of the best fit with another count of waves, less that of
        this fit; below 10 the count is in doubt.
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
    """Fit the phase of `levels` grey levels to a sweep.

    expected_range: radians at the highest level, as stated by a data sheet.

    The model is a cubic spline of increments that aren't negative, with swing and offset of the
    light, the blur by neighbouring pixels, ripple and, if it is significant, a ghost. It is fitted
    by least squares in units of the noise, from many starting curves (0.6 to 1.45 times the
    expected range). The number of coefficients is the one with the smallest Bayesian information
    criterion. Frames farther than five standard deviations from the fit are left out, and the fit
    is repeated once. Raises ValueError if the light hardly varies, or doesn't follow such a curve.
    """
    if not 0 < expected_range < math.inf:
        raise ValueError(
            f"expected_range is {expected_range:g} rad; it must be positive and finite"
        )
    low, high = np.percentile(sweep.light, [5, 95])
    if not high - low > _MIN_SWING_TO_NOISE * np.median(sweep.noise):
        raise ValueError(
            f"the light in the first orders comes and goes by {high - low:.3g}, with a noise of "
            f"{np.median(sweep.noise):.3g}: too little to see the phase; expose longer, or check "
            "the polariser and that the panel shows the gratings"
        )
    found = _fit_curves(sweep, levels, expected_range)
    best = found[0]
    misfit = np.abs(best.predicted_light() - sweep.light) / sweep.noise
    # Frames are compared with the median residual, and with their noise at least.
    used = misfit <= _OUTLIER_SIGMAS * max(1.4826 * float(np.median(misfit)), 1.0)
    if not used.all() and used.sum() >= MIN_LEVELS:
        found = _fit_curves(sweep.select(used), levels, expected_range)
        best = replace(found[0], sweep=sweep)
    else:
        used = np.ones(len(used), dtype=bool)
    # A rival counts the waves otherwise: its phase range differs by more than π/2.
    rivals = [
        curve.information_criterion
        for curve in found
        if abs(curve.phase_range - found[0].phase_range) > math.pi / 2
    ]
    rival_margin = min(rivals, default=math.inf) - found[0].information_criterion
    return _build_response_fit(best, used, levels, rival_margin)


def _fit_curves(sweep: Sweep, levels: int, expected_range: float) -> list[PhaseCurve]:
    """Fit phase curves to a sweep from several starts; the best comes first.

    Each curve has the number of increments that suits it best.
    """
    found: list[PhaseCurve] = []
    coarse = [start.fit() for start in _starts(sweep, levels - 1, expected_range)]
    distinct: list[PhaseCurve] = []
    for curve in sorted(coarse, key=lambda curve: curve.cost):
        if all(abs(curve.phase_range - one.phase_range) > _SAME_RANGE for one in distinct):
            distinct.append(curve)
    for start in distinct[:_STARTS_REFINED]:
        tried = [start]
        for count in _INCREMENT_COUNTS[1:]:
            if FIRST_INCREMENT + count > len(sweep.light) - 4:
                break
            tried.append(tried[-1].with_increments(count).fit())
        found.append(min(tried, key=lambda curve: curve.information_criterion))
    best = min(found, key=lambda curve: curve.information_criterion)
    with_ghost = replace(best, ghost_sigma=SOME_GHOST).fit()
    if with_ghost.information_criterion < best.information_criterion - _GHOST_MARGIN:
        found.append(with_ghost)
    return sorted(found, key=lambda curve: curve.information_criterion)


def _starts(sweep: Sweep, top: int, expected_range: float) -> list[PhaseCurve]:
    """Choose the starting curves: the best of many that differ in phase range and shape."""
    fine = np.linspace(0, top, 200)
    basis = monotone_spline_basis(fine, top, _INCREMENT_COUNTS[0])
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


def _build_response_fit(
    best: PhaseCurve, inliers: NDArray[np.bool_], levels: int, rival_margin: float
) -> ResponseFit:
    """Build the response from the best curve, or raise ValueError for a bad fit."""
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
    basis = monotone_spline_basis(np.arange(levels), levels - 1, len(best.increments))
    # A parameter on a bound counts as free, so that the covariance isn't too small.
    jacobian = best.jacobian(p)
    jacobian = jacobian[np.append(inliers, np.ones(len(jacobian) - len(inliers), dtype=bool))]
    covariance = np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-12, hermitian=True) * max(chi2, 1.0)
    spread = basis @ covariance[FIRST_INCREMENT:, FIRST_INCREMENT:]
    shift = min(_BLUR_PHASE_ERROR * p[BLUR2] / sweep.law.period**2, math.pi)
    # A ghost shifts all phases by twice its share. Half of that shift is taken as uncertainty.
    doubt = math.hypot(_BLUR_UNCERTAINTY * shift, p[GHOST])
    return ResponseFit(
        np.maximum.accumulate(basis @ best.increments),
        np.sqrt(np.clip((spread * basis).sum(1), 0, None) + doubt**2),
        math.sqrt(p[BLUR2]), math.sqrt(p[RIPPLE2]), float(p[SWING]), float(p[OFFSET]),
        float(p[GHOST]), predicted, inliers, residual, chi2, rival_margin,
    )  # fmt: skip
