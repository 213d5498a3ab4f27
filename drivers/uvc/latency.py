"""Find how many frames a UVC camera still delivers with the old exposure after a change."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def count_old_frames(before: float, levels: Sequence[tuple[int, float]]) -> int:
    """Count the UVC frames that still have the old exposure after a change.

    before: mean digital number of pictures with the old exposure. levels: for each picture after
    the change, in order: how many frames came since the change, and its mean digital number.
    ValueError if the pictures don't change clearly, or not in time.
    """
    if len(levels) < 8:
        raise ValueError(f"{len(levels)} pictures are too few")
    after = float(np.median([level for _, level in levels[-len(levels) // 4 :]]))
    step = after - before
    if abs(step) < 0.2 * max(abs(after), abs(before), 1.0):
        raise ValueError(
            f"pictures of {before:.0f} became pictures of {after:.0f}; give two exposures that "
            "differ more, neither of them too dark or clipped"
        )
    # A picture has the new exposure if its level is within a tenth of the step from the last.
    late = [index for index, level in levels if abs(level - after) > 0.1 * abs(step)]
    latency = late[-1] + 1 if late else 0
    if latency > levels[len(levels) // 2][0]:
        raise ValueError("the pictures don't settle; see that the light is steady")
    return latency
