"""The phase response over grey levels, from the light in the first orders of stripe patterns.

Stripes of two levels send the share sin²(step / 2) of the largest possible light into their first
order, where step is the difference of their phases. Over a sweep of levels this light rises and
falls once per wave. A smooth, rising phase is fitted to it, which also counts the waves. Near the
light's maxima and minima it hardly depends on the phase. A second reference level, about a quarter
of a wave from the first, is most sensitive at these levels.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
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
    SWING,
    PhaseCurve,
    Sweep,
    monotone_spline_basis,
)
from optics.measuring.phase_curve import SETTINGS as CURVE_SETTINGS

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ResponseFitSettings:
    """Tune the search for a panel's phase response; all values are chosen.

    increment_counts: numbers of spline increments, tried in this order, each from the result of the
        one before.
    gammas: exponents of the level in the starting curves.
    ghost_margin: improvement of the information criterion from which a ghost is accepted.
    first_blur2: starting value of the squared blur, panel pixels squared.
    first_ripple2: starting value of the squared ripple.
    starts_fitted: number of the starting curves that are fitted.
    starts_refined: number of the fitted curves that are refined with more increments.
    same_range: radians at the highest level within which two coarse curves count as the same.
    outlier_sigmas: standard deviations beyond which a frame is an outlier.
    min_swing_to_noise: least swing of the light, in standard deviations of its noise.
    blur_phase_error: radians by which blur moves the light's turning points, per square of the
        ratio of blur to the stripes' period.
    blur_uncertainty: relative uncertainty of that shift, because the blur needn't be a Gaussian.
    max_residual: root mean square residual, as a share of the swing, beyond which a fit is refused.
    """

    increment_counts: tuple[int, ...] = (5, 7, 9, 11, 13, 15, 18)
    gammas: tuple[float, ...] = (0.6, 0.8, 1.0, 1.25, 1.6)
    ghost_margin: float = 16.0
    first_blur2: float = 0.04
    first_ripple2: float = 1e-5
    starts_fitted: int = 8
    starts_refined: int = 3
    same_range: float = 0.3
    outlier_sigmas: float = 5.0
    min_swing_to_noise: float = 10.0
    blur_phase_error: float = 108.0
    blur_uncertainty: float = 0.05
    max_residual: float = 0.1


_SETTINGS = ResponseFitSettings()

_TRIAL_RANGES = np.linspace(0.6, 1.45, 35)
"""Phase ranges of the starting curves, relative to the expected range."""


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
    _require_swing(sweep)
    found = _fit_curves(sweep, levels, expected_range)
    best = found[0]
    away = np.abs(best.misfit) * sweep.noise / _scatter(best.misfit * sweep.noise, sweep.noise)
    used = away <= _SETTINGS.outlier_sigmas
    if not used.all() and used.sum() >= MIN_LEVELS:
        found = _fit_curves(sweep.select(used), levels, expected_range)
        best = replace(found[0], sweep=sweep)
    else:
        used = np.ones(len(used), dtype=bool)
    return _build_response_fit(best, used, levels, _rival_margin(found))


def _require_swing(sweep: Sweep) -> None:
    """Raise ValueError for a sweep whose light hardly varies."""
    low, high = np.percentile(sweep.light, [5, 95])
    if not high - low > _SETTINGS.min_swing_to_noise * np.median(sweep.noise):
        raise ValueError(
            f"the light in the first orders comes and goes by {high - low:.3g}, with a noise of "
            f"{np.median(sweep.noise):.3g}: too little to see the phase; expose longer, or check "
            "the polariser and that the panel shows the gratings"
        )


def _scatter(misses: Array, noise: Array) -> Array:
    """Estimate each frame's standard deviation from the median residual; its noise at least."""
    typical = 1.4826 * float(np.median(np.abs(misses / noise)))
    return noise * max(typical, 1.0)


def _fit_curves(sweep: Sweep, levels: int, expected_range: float) -> list[PhaseCurve]:
    """Fit phase curves to a sweep from several starts; the best comes first.

    Each curve has the number of increments that suits it best.
    """
    top = levels - 1
    found: list[PhaseCurve] = []
    coarse = [start.fit() for start in _starts(sweep, top, expected_range)]
    distinct = _distinct_curves(sorted(coarse, key=lambda curve: curve.cost))
    for start in distinct[: _SETTINGS.starts_refined]:
        tried = [start]
        for count in _SETTINGS.increment_counts[1:]:
            if FIRST_INCREMENT + count > len(sweep.light) - 4:
                break
            tried.append(tried[-1].with_increments(count).fit())
        found.append(min(tried, key=lambda curve: curve.information_criterion))
    best = min(found, key=lambda curve: curve.information_criterion)
    with_ghost = replace(best, ghost_sigma=CURVE_SETTINGS.some_ghost).fit()
    if with_ghost.information_criterion < best.information_criterion - _SETTINGS.ghost_margin:
        found.append(with_ghost)
    return sorted(found, key=lambda curve: curve.information_criterion)


def _distinct_curves(curves: list[PhaseCurve]) -> list[PhaseCurve]:
    """Drop curves whose phase range is that of a better curve; the best come first."""
    kept: list[PhaseCurve] = []
    for curve in curves:
        if all(abs(curve.phase_range - other.phase_range) > _SETTINGS.same_range for other in kept):
            kept.append(curve)
    return kept


def _starts(sweep: Sweep, top: int, expected_range: float) -> Iterable[PhaseCurve]:
    """Choose the starting curves: the best of many that differ in phase range and shape."""
    count = _SETTINGS.increment_counts[0]
    fine = np.linspace(0, top, 200)
    basis = monotone_spline_basis(fine, top, count)
    lead = [1, 0, _SETTINGS.first_blur2, _SETTINGS.first_ripple2, 0]
    tried = []
    for gamma in _SETTINGS.gammas:
        shape, *_ = np.linalg.lstsq(basis, (fine / top) ** gamma, rcond=None)
        shape = np.clip(shape, 1e-3, None)
        for reach in _TRIAL_RANGES:
            increments = reach * expected_range * shape / shape.sum()
            curve = PhaseCurve(sweep, top, np.concatenate([lead, increments]))
            tried.append(curve.with_fitted_swing())
    tried = [curve for curve in tried if curve.parameters[SWING] > 0] or tried
    return sorted(tried, key=lambda curve: curve.cost)[: _SETTINGS.starts_fitted]


def _rival_margin(curves: list[PhaseCurve]) -> float:
    """Compute by how much the best fit of another phase range is worse.

    It is a difference of information criteria. Another phase range differs by more than π/2.
    """
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
    """Build the response from the best curve, or raise ValueError for a bad fit."""
    sweep, p = best.sweep, best.parameters
    predicted = best.predicted_light()
    misses = (sweep.light - predicted)[inliers]
    residual = float(np.sqrt((misses**2).mean())) / p[SWING]
    if not residual < _SETTINGS.max_residual:
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
    shift = min(_SETTINGS.blur_phase_error * p[BLUR2] / sweep.law.period**2, math.pi)
    blurred = _SETTINGS.blur_uncertainty * shift
    # A ghost shifts all phases by twice its share. Half of that shift is taken as uncertainty.
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
