"""Fit the photon transfer curve: temporal variance over signal, whose slope is the gain.

A pixel of even light holds N electrons with a variance of N (Poisson). With K digital numbers per
electron, the signal is K N and its variance K² N = K · signal, besides noise that darkness has too
(EMVA 1288 release 4 linear, equations 10 to 12; Janesick, Photon Transfer, SPIE Press 2007).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from optics.camera_noise.group_statistics import GroupStatistics, LightStatistics
from optics.camera_noise.measured import Array, Measured
from optics.camera_noise.rounded_noise import STEP_VARIANCE, SURE_VARIANCE
from optics.camera_noise.saturation import is_open

FIT_SHARE = 0.7
"""Share of saturation up to which the curve is fitted (EMVA 1288, section 6.6)."""

_PASSES = 4
"""Passes in which weights follow the fit. The third changes the gain by less than 1e-6."""

_FEWEST = 3
"""Fewest exposure times that are fitted."""


@dataclass(frozen=True, eq=False)
class PhotonTransfer:
    """A camera's photon transfer curve and its fit.

    system_gain: K, DN per electron. offset: what the dark number is too large by, DN, where the
    converter's steps are too coarse to tell it; 0 otherwise. covariance: (2, 2), of both. chi2:
    mean squared residual per degree of freedom. signal, variance, sigma: points, DN, DN² and the
    variance's uncertainty, (n,). exposure: of each, seconds. used: whether the fit uses it.
    """

    system_gain: Measured
    offset: Measured
    covariance: Array
    chi2: float
    freedom: int
    signal: Array
    variance: Array
    sigma: Array
    exposure: Array
    used: NDArray[np.bool_]


def fit_photon_transfer(
    groups: Sequence[GroupStatistics], full: float | None, coarse: Measured | None
) -> PhotonTransfer:
    """Fit a camera's photon transfer curve through zero to all groups of its pixels.

    full: signal at which pixels clip, DN; None if none does. coarse: variance of the dark noise,
    DN², where the dark numbers don't show it. The dark number is then uncertain by a part of a
    step, and is fitted too. Weights are those that the fit predicts, since measured ones would
    favour what is low by chance. Raises ValueError if too few exposures are below saturation.
    """
    points = [one for group in groups for one in group.light]
    signal = np.array([one.signal for one in points])
    used = np.array([_is_fitted(one, full, coarse) for one in points])
    exposure = np.array([one.exposure for one in points])
    if len(set(exposure[used])) < _FEWEST:
        raise ValueError(
            f"{len(set(exposure[used]))} exposure times are above darkness and below "
            f"{FIT_SHARE:.0%} of saturation, and the fit needs {_FEWEST} or more; take shorter "
            "ones, or dim the light"
        )
    dark = np.array([one.dark_variance for one in points])
    if coarse is not None:
        dark = np.full(len(points), STEP_VARIANCE + coarse.value)
    variance = np.array([one.variance for one in points]) - dark
    gain, offset = float(variance[used].sum() / signal[used].sum()), 0.0
    for _ in range(_PASSES):
        sigma = _uncertainties(points, gain, offset, coarse)
        gain, offset, covariance = _fit(signal, variance, sigma, used, coarse is not None)
    left = (variance - gain * (signal + offset))[used] / sigma[used]
    freedom = int(used.sum()) - (1 if coarse is None else 2)
    chi2 = float((left**2).sum()) / max(freedom, 1)
    covariance = covariance * max(chi2, 1.0)
    if coarse is not None:
        # An error of the dark noise raises or lowers the whole line.
        covariance[1, 1] += (coarse.sigma / gain) ** 2
    errors = np.sqrt(np.diag(covariance))
    return PhotonTransfer(
        Measured(gain, float(errors[0])), Measured(offset, float(errors[1])), covariance,
        chi2, freedom, signal, variance, sigma, exposure, used,
    )  # fmt: skip


def electrons(transfer: PhotonTransfer, signal: Measured) -> Measured:
    """Return the electrons of a camera's signal, DN, above its measured dark number."""
    gain, offset = transfer.system_gain.value, transfer.offset.value
    value = (signal.value + offset) / gain
    slopes = np.array([-value / gain, 1 / gain])
    variance = float(slopes @ transfer.covariance @ slopes) + (signal.sigma / gain) ** 2
    return Measured(value, math.sqrt(variance))


def _is_fitted(one: LightStatistics, full: float | None, coarse: Measured | None) -> bool:
    """Tell whether a camera's photon transfer curve is fitted to a group of pixels."""
    sure = coarse is None or one.variance - STEP_VARIANCE > SURE_VARIANCE
    return sure and one.signal > 0 and is_open(one, full, FIT_SHARE)


def _uncertainties(
    points: Sequence[LightStatistics], gain: float, offset: float, coarse: Measured | None
) -> Array:
    """Return the uncertainties of a camera's points, variances less dark variances, DN²."""
    found = []
    for one in points:
        dark = one.dark_variance if coarse is None else STEP_VARIANCE + coarse.value
        expected = max(gain * (one.signal + offset), 0.0) + dark
        own = expected * math.sqrt(one.spread / one.count)
        shared = dark * math.sqrt(one.dark_spread / one.dark_count) if coarse is None else 0.0
        # The mean's noise moves a point along the line.
        along = gain * math.sqrt(expected / (2 * one.count) + dark / (2 * one.dark_count))
        found.append(math.sqrt(own**2 + shared**2 + along**2))
    return np.array(found)


def _fit(
    signal: Array, variance: Array, sigma: Array, used: NDArray[np.bool_], with_offset: bool
) -> tuple[float, float, Array]:
    """Return slope and offset of a camera's photon transfer curve, and their covariance."""
    x, y, s = signal[used], variance[used], sigma[used]
    if not with_offset:
        information = float((x**2 / s**2).sum())
        return float((x * y / s**2).sum()) / information, 0.0, np.diag([1 / information, 0.0])
    design = np.stack([x, np.ones_like(x)], axis=1) / s[:, None]
    covariance = np.linalg.inv(design.T @ design)
    slope, start = covariance @ design.T @ (y / s)
    offset = start / slope
    # The offset is start over slope.
    to_offset = np.array([[1.0, 0.0], [-offset / slope, 1 / slope]])
    return float(slope), float(offset), to_offset @ covariance @ to_offset.T
