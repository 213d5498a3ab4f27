"""Check that grey levels are shown unchanged, and explain it if they aren't."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def gamma_ramp_error(ramp: NDArray[np.uint16]) -> str:
    """Describe how a gamma ramp changes grey levels; empty if it doesn't.

    ramp: (3, n), 0 to 65535. An X server may keep only 8 bits of it, truncated or rounded.
    """
    size = ramp.shape[1]
    if size < 2:
        return ""
    plain = np.linspace(0, 65535, size)
    kept = ramp.astype(float)
    cut = ramp >> 8 == np.floor(plain).astype(np.uint16) >> 8
    if (cut | (abs(kept - plain) <= 128)).all():
        return ""
    worst = abs(kept - plain).max() / 257
    return f"the screen's gamma ramp changes grey levels by up to {worst:.0f} of 255"


def readback_error(readback: NDArray[np.uint8], grey: NDArray[np.uint8]) -> str:
    """Describe how what is shown differs from a pattern; empty if every pixel agrees.

    readback: (rows, columns, 3 or 4), of which the first three are colours. grey: the pattern,
    (rows, columns).
    """
    wrong = np.zeros(grey.shape, bool)
    for colour in range(3):
        wrong |= readback[..., colour] != grey
    count = int(wrong.sum())
    if not count:
        return ""
    return f"{count} of {grey.size} pixels are wrong: {_mismatch_cause(readback, grey, wrong)}"


def _mismatch_cause(
    seen: NDArray[np.uint8], grey: NDArray[np.uint8], wrong: NDArray[np.bool_]
) -> str:
    rows, columns = np.flatnonzero(wrong.any(1)), np.flatnonzero(wrong.any(0))
    top, left = int(rows[0]), int(columns[0])
    height, width = int(rows[-1]) - top + 1, int(columns[-1]) - left + 1
    if height * width < 0.98 * grey.size:
        return f"another window lies on top, at {left},{top}, {width}x{height} pixels"
    if _is_mapped(seen, grey):
        return "each grey level is changed alike, as by colour management or a compositor"
    return "the picture is scaled, shifted or covered (desktop scaling, another window on top)"


def _is_mapped(seen: NDArray[np.uint8], grey: NDArray[np.uint8]) -> bool:
    """Return whether every grey level appears as one colour.

    False if the picture has only one level.
    """
    levels = grey.ravel().astype(np.intp)
    count = np.count_nonzero(np.bincount(levels))
    pairs = (256 * levels + seen[..., colour].ravel() for colour in range(3))
    return bool(count > 1) and all(np.count_nonzero(np.bincount(pair)) == count for pair in pairs)
