"""How many frames a camera gives before a new exposure shows in them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

_LEVEL_TOLERANCE = 0.1
"""Share of a step within which a level has arrived."""


def count_old_frames(before: float, levels: Sequence[tuple[int, float]]) -> int:
    """The frames that still have the old exposure.

    before: mean number of pictures of the old exposure. levels: of pictures after the change,
    in order: how many frames came in between, and the mean number. ValueError if the pictures
    don't change clearly, or not in time.
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
    late = [index for index, level in levels if abs(level - after) > _LEVEL_TOLERANCE * abs(step)]
    latency = late[-1] + 1 if late else 0
    if latency > levels[len(levels) // 2][0]:
        raise ValueError("the pictures don't settle; see that the light is steady")
    return latency
