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

from optics.calibration.curve import (
    BLUR2,
    GHOST,
    LEAD,
    OFFSET,
    RIPPLE2,
    SOME_GHOST,
    SWING,
    Curve,
    rising_basis,
)
from optics.calibration.sweep import FEWEST, Sweep

Array = NDArray[np.float64]

_COEFFICIENTS = (5, 7, 9, 11, 13, 15, 18)
"""Of the curve, tried in this order, each from the one before."""

_REACHES = np.linspace(0.6, 1.45, 35)
_GAMMAS = (0.6, 0.8, 1.0, 1.25, 1.6)
"""Starts: ranges over the expected one, and powers of the level."""

_WORTH = 16.0
"""Of the information criterion, by which a ghost must make the fit better to be believed in."""

_FIRST_BLUR2, _FIRST_RIPPLE2 = 0.04, 1e-5

_KEPT, _FOLLOWED = 8, 3
"""Of the starts, that are tried; and of these, that are followed to finer curves."""

_ALIKE = 0.3
"""Radians at the highest level by which two coarse curves are the same."""

_OUTLYING = 5.0
_FAINTEST = 10.0
"""Times its noise that the light must come and go by."""

_BLURRED, _BLUR_DOUBT = 108.0, 0.05
"""Radians by which a blur of one period moves the light's turning points, times its square;
and how far a Gaussian may be wrong about it."""

_POOREST = 0.1
"""Of the swing, root mean square, beyond which a fit is none."""


@dataclass(frozen=True, eq=False)
class ResponseFit:
    """A fitted curve: phase less that of level 0, radians, of all levels (levels,).

    sigma: standard deviation of phase, (levels,). blur: of the phase by neighbours, panel
    pixels. ripple: of the phase within a frame, as a share of it. swing, offset: of the light.
    ghost: light of the zeroth order that interferes, as a share of the swing.
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
    ghost: float
    predicted: Array
    used: NDArray[np.bool_]
    residual: float
    chi2: float
    rival: float


def fit_response(sweep: Sweep, levels: int, expected: float) -> ResponseFit:
    """The phase of `levels` grey levels; expected: radians at the highest, as a data sheet says.

    A rising cubic spline whose increments aren't negative, with swing and offset of the light,
    neighbours' blur, ripple and, where it is plain to see, a ghost, by least squares in units of
    noise, from many starts (0.6 to 1.45 times the expected range). The number of coefficients is
    the one with the smallest Bayesian information criterion. Frames farther than five deviations
    from the fit are left out once. Raises ValueError if the light doesn't come and go, or follows
    no such curve.
    """
    if not 0 < expected < math.inf:
        raise ValueError(f"expected is {expected:g} rad; it must be positive and finite")
    _require_swing(sweep)
    found = _fitted(sweep, levels, expected)
    best = found[0]
    away = np.abs(best.misfit) * sweep.noise / _scatter(best.misfit * sweep.noise, sweep.noise)
    used = away <= _OUTLYING
    if not used.all() and used.sum() >= FEWEST:
        found = _fitted(sweep.some(used), levels, expected)
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


def _scatter(misses: Array, noise: Array) -> Array:
    """Standard deviation of a frame, at least that of its noise, by the median of all."""
    typical = 1.4826 * float(np.median(np.abs(misses / noise)))
    return noise * max(typical, 1.0)


def _fitted(sweep: Sweep, levels: int, expected: float) -> list[Curve]:
    """Curves that fit, the best first; each of its own start, with its best size."""
    top = levels - 1
    found: list[Curve] = []
    coarse = [start.solved() for start in _starts(sweep, top, expected)]
    for start in _different(sorted(coarse, key=lambda curve: curve.cost))[:_FOLLOWED]:
        tried = [start]
        for count in _COEFFICIENTS[1:]:
            if LEAD + count > len(sweep.light) - 4:
                break
            tried.append(tried[-1].refined(count).solved())
        found.append(min(tried, key=lambda curve: curve.criterion))
    best = min(found, key=lambda curve: curve.criterion)
    haunted = replace(best, haunted=SOME_GHOST).solved()
    if haunted.criterion < best.criterion - _WORTH:
        found.append(haunted)
    return sorted(found, key=lambda curve: curve.criterion)


def _different(curves: list[Curve]) -> list[Curve]:
    """Without those that ended where a better one did."""
    kept: list[Curve] = []
    for curve in curves:
        if all(abs(curve.reach - other.reach) > _ALIKE for other in kept):
            kept.append(curve)
    return kept


def _starts(sweep: Sweep, top: int, expected: float) -> Iterable[Curve]:
    """The most promising of many ranges and shapes, all of them different."""
    count = _COEFFICIENTS[0]
    fine = np.linspace(0, top, 200)
    basis = rising_basis(fine, top, count)
    lead = [1, 0, _FIRST_BLUR2, _FIRST_RIPPLE2, 0]
    tried = []
    for gamma in _GAMMAS:
        shape, *_ = np.linalg.lstsq(basis, (fine / top) ** gamma, rcond=None)
        shape = np.clip(shape, 1e-3, None)
        for reach in _REACHES:
            increments = reach * expected * shape / shape.sum()
            curve = Curve(sweep, top, np.concatenate([lead, increments]))
            tried.append(curve.with_lamp())
    tried = [curve for curve in tried if curve.parameters[SWING] > 0] or tried
    return sorted(tried, key=lambda curve: curve.cost)[:_KEPT]


def _rival(found: list[Curve]) -> float:
    """How much worse the best fit with another count of waves is."""
    best = found[0]
    others = [c.criterion for c in found if abs(c.reach - best.reach) > math.pi / 2]
    return min(others, default=math.inf) - best.criterion


def _told(best: Curve, used: NDArray[np.bool_], levels: int, rival: float) -> ResponseFit:
    sweep, p = best.sweep, best.parameters
    predicted = best.light()
    misses = (sweep.light - predicted)[used]
    residual = float(np.sqrt((misses**2).mean())) / p[SWING]
    if not residual < _POOREST:
        raise ValueError(
            f"the light follows no rising phase: it is off by {residual:.0%} of its swing, root "
            "mean square; check that the lamp is steady and that the table of the panel's range "
            "is right to a third"
        )
    freedom = max(int(used.sum()) - len(p), 1)
    chi2 = float(((misses / sweep.noise[used]) ** 2).sum()) / freedom
    basis = rising_basis(np.arange(levels), levels - 1, best.count)
    covariance = best.covariance(used) * max(chi2, 1.0)
    spread = basis @ covariance[LEAD:, LEAD:]
    # A ghost moves all phases by twice its share; half of that is not believed.
    blurred = _BLUR_DOUBT * min(_BLURRED * p[BLUR2] / sweep.law.period**2, math.pi)
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
        used=used,
        residual=residual,
        chi2=chi2,
        rival=rival,
    )
