"""Find pixels of a sensor that don't measure light, by the frames of a bracket and its darks.

A hot pixel has more dark signal than others. Dark frames take its mean off, and leave its noise,
which no stated variance counts. A stuck pixel has the same number at every exposure time.
EMVA 1288 (release 4.0, chapter 8) calls both defect pixels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from optics.hdr.bracket import Bracket

Mask = NDArray[np.bool_]

_HOT = 8.0
"""Robust standard deviations of dark frames from their median from which a pixel is hot. Chosen: in
ten megapixels none is by chance, with tails as heavy as that of dark currents in a good sensor."""

_STUCK = 5.0
"""Standard deviations without light within which all numbers of a stuck pixel agree. Chosen."""

_LIT = 10.0
"""Standard deviations without light above its dark level from which on a constant number isn't that
of a dark pixel. Chosen: more than two of _STUCK's."""

_LEAST_FRAMES, _LEAST_RATIO = 3, 4.0
"""Different exposures, and ratio of the longest to the shortest, from which on a constant number
can't be light. Chosen."""


_LISTED = 5
"""Pixels that are listed by their places. Chosen."""


@dataclass(frozen=True, eq=False)
class Defects:
    """Pixels that don't measure light, (rows, columns): hot in dark frames, or stuck in all."""

    hot: Mask
    stuck: Mask

    @property
    def mask(self) -> Mask:
        """Return all defective pixels."""
        return self.hot | self.stuck

    def explain(self) -> list[str]:
        """Say in words how many pixels are defective; nothing if none is."""
        found = []
        for mask, what in (
            (self.hot, "hot: the dark frames say so"),
            (self.stuck, "stuck: they have one number at all exposure times"),
        ):
            rows, columns = np.nonzero(mask)
            if rows.size:
                places = ", ".join(
                    f"({y}, {x})" for y, x in zip(rows[:_LISTED], columns[:_LISTED], strict=True)
                )
                more = ", …" if rows.size > _LISTED else ""
                found.append(f"{rows.size} pixels are {what}; (row, column) {places}{more}")
        return found


def find_defects(bracket: Bracket) -> Defects:
    """Find hot pixels by the dark frames, and stuck ones by the frames.

    Parameters
    ----------
    bracket : Bracket
        Hot pixels are found where its darks are measured frames, and stuck ones in three exposure
        times or more.

    Returns
    -------
    Defects
    """
    hot, stuck = (np.zeros(bracket.shape, dtype=bool) for _ in range(2))
    longest = bracket.exposures[-1]
    dark = bracket.darks[longest.frames[0]]
    if np.ndim(dark) and math.isfinite(longest.darks):
        hot = _is_hot(np.asarray(dark))
    exposures = bracket.exposures
    ratio = exposures[-1].time / exposures[0].time
    if len(exposures) >= _LEAST_FRAMES and ratio >= _LEAST_RATIO:
        stuck = _is_stuck(bracket)
    return Defects(hot, stuck & ~hot)


def _is_hot(dark: NDArray[np.floating]) -> Mask:
    """Return where a mean dark frame is far above its median."""
    middle = np.median(dark)
    spread = 1.4826 * float(np.median(np.abs(dark - middle)))
    if spread == 0:
        # Most pixels have the same whole number.
        spread = max(float(np.std(np.clip(dark, middle - 1, middle + 1))), 1 / math.sqrt(12))
    return np.asarray(dark - middle > _HOT * spread)


def _is_stuck(bracket: Bracket) -> Mask:
    """Return where all frames have one number that is neither that of no light nor clipped."""
    gain, full = bracket.sensor.gain, bracket.sensor.full_scale
    noise = math.sqrt(max(one.floor for one in bracket.exposures)) / gain
    level = max(one.dark_level for one in bracket.exposures)
    lowest, highest = (np.array(bracket.frames[0]) for _ in range(2))
    for frame in bracket.frames:
        np.minimum(lowest, frame, out=lowest)
        np.maximum(highest, frame, out=highest)
    constant = highest - lowest <= _STUCK * noise
    return np.asarray(constant & (lowest > level + _LIT * noise) & (highest < full))
