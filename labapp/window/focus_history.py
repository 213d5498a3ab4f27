"""The course of focus score and star width over time, as plots show it."""

from __future__ import annotations

import statistics
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from labapp.window.measuring_messages import PictureMeasured, PixelRegion

KEPT_SECONDS = 120.0
"""Seconds of the course that are kept. Chosen: as long as a person turns a focus ring."""

_STEADY = 5
"""Neighbouring values whose median counts for the best one. Chosen: noise alone makes no best."""


@dataclass(frozen=True)
class FocusPoint:
    """One measurement; None where there is no value.

    taken_at: s, on the engine's clock.
    fwhm: star width, pixels.
    focus: score, 1/pixel².
    """

    taken_at: float
    fwhm: float | None
    focus: float | None


class FocusHistory:
    """Keep the measurements of one target in one region; others don't compare with them.

    A pattern on the SLM may change: a person may focus by it.
    """

    def __init__(self) -> None:
        self._points: deque[FocusPoint] = deque()
        self._measured: tuple[str, float, PixelRegion] | None = None

    @property
    def points(self) -> tuple[FocusPoint, ...]:
        """Return the measurements, the earliest first."""
        return tuple(self._points)

    def add(self, measured: PictureMeasured) -> None:
        """Add a measurement; begin anew at another target, wavelength or region."""
        region = measured.region
        if region is None:
            return
        what = measured.target, measured.wavelength, region.region
        if what != self._measured:
            self.clear()
            self._measured = what
        fwhm = None if region.star is None else region.star.fwhm
        self._points.append(FocusPoint(measured.taken_at, fwhm, region.focus))
        while self._points[-1].taken_at - self._points[0].taken_at > KEPT_SECONDS:
            self._points.popleft()

    def clear(self) -> None:
        self._points.clear()
        self._measured = None

    @property
    def best_fwhm(self) -> float | None:
        """Return the least width in pixels that was seen steadily; None without any."""
        return _best([point.fwhm for point in self._points], min)

    @property
    def best_focus(self) -> float | None:
        """Return the highest focus score that was seen steadily; None without any."""
        return _best([point.focus for point in self._points], max)


def _best(
    values: Sequence[float | None], choose: Callable[[Sequence[float]], float]
) -> float | None:
    """Return the best of the medians of neighbouring values."""
    known = [value for value in values if value is not None]
    medians = [
        statistics.median(known[first : first + _STEADY])
        for first in range(max(1, len(known) - _STEADY + 1))
        if known
    ]
    return choose(medians) if medians else None
