"""Compute a camera's PRNU and DSNU from sums over two halves of its frames."""

from __future__ import annotations

import math
from collections.abc import Sequence

from optics.camera_noise.group_statistics import GroupStatistics, HalfProducts, box_share
from optics.camera_noise.measured import Measured
from optics.camera_noise.rounded_noise import STEP_VARIANCE


def photo_response_nonuniformity(groups: Sequence[GroupStatistics]) -> Measured | None:
    """Return a camera's PRNU: the relative standard deviation of its pixels' response.

    Slow changes over the sensor are left out, as the light's (EMVA 1288 release 4, section 8), and
    defective pixels. None if no exposure was bright and unclipped.
    """
    total = sum((one.response for one in groups), HalfProducts())
    return (_covariance(total) * (1 / box_share())).root if total.count > 1 else None


def dark_signal_nonuniformity(groups: Sequence[GroupStatistics], *, is_coarse: bool) -> Measured:
    """Return a camera's DSNU: the standard deviation over pixels of the dark number, DN.

    It is that at the exposure times of the light, without defective pixels. is_coarse: whether the
    noise is too small to average over the converter's steps, so that their rounding is in it.
    """
    found = _covariance(sum((one.offsets for one in groups), HalfProducts()))
    if is_coarse:
        found = Measured(found.value, math.hypot(found.sigma, STEP_VARIANCE))
    return found.root


def _covariance(sums: HalfProducts) -> Measured:
    """Return the covariance of two halves of a camera's map over its pixels.

    The uncertainty is that of normal pixels (Wishart's distribution).
    """
    n = sums.count
    means = sums.first / n, sums.second / n
    products = sums.products / n - means[0] * means[1]
    squares = (sums.first_squares / n - means[0] ** 2, sums.second_squares / n - means[1] ** 2)
    sigma = math.sqrt(max(squares[0] * squares[1] + products**2, 0.0) / (n - 1))
    return Measured(products * n / (n - 1), sigma)
