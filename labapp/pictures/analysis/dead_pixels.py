"""Find pixels of a sensor that give no light of their own."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from labapp.pictures.analysis.brackets import Bracket

_LEAST_SHARE = 0.1
"""Share of its neighbours' median light below which a pixel may be dead."""

_SIGNIFICANCE = 6.0
"""Standard deviations by which it must be below that median, in every picture that is bright
there."""

_BRIGHT = 10.0
"""Standard deviations of a neighbourhood's light from which it tells of a dead pixel."""


def find_dead_pixels(brackets: Sequence[Bracket], period: tuple[int, int]) -> NDArray[np.bool_]:
    """Find a sensor's dead pixels from at least one merged bracket.

    A dead pixel stays dark wherever the pixels around it that see the same colour are bright, in
    all brackets. Pixels that none shows brightly aren't judged. Returns (rows, columns), True where
    a pixel is dead.

    period: of the colour filters, (rows, columns); (1, 1) without filters.
    """
    seen = np.zeros(brackets[0].rate.shape, dtype=bool)
    dead = np.ones_like(seen)
    for bracket in brackets:
        near = _median_of_same_colour(bracket.rate, period)
        deviation = np.sqrt(np.where(np.isfinite(bracket.variance), bracket.variance, np.inf))
        bright = near > _BRIGHT * deviation
        dark = (bracket.rate < _LEAST_SHARE * near) & (
            near - bracket.rate > _SIGNIFICANCE * deviation
        )
        dead &= ~bright | dark
        seen |= bright
    return dead & seen


def _median_of_same_colour(
    rate: NDArray[np.float64], period: tuple[int, int]
) -> NDArray[np.float64]:
    """Return the median of the 5 x 5 nearest pixels of the same colour."""
    near = np.empty_like(rate)
    for row in range(period[0]):
        for column in range(period[1]):
            at = slice(row, None, period[0]), slice(column, None, period[1])
            plane = np.ascontiguousarray(rate[at], dtype=np.float32)
            # A frame of one row has no pixels of the second row's colours.
            near[at] = cv2.medianBlur(plane, 5) if plane.size else plane
    return near
