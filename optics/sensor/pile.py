"""Recognise the number at which a camera's pixels pile up, because they clip there."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

LEAST_PILE = 20
"""Pixels that share the largest number from which on they can be a pile. Chosen: noise alone seldom
leaves so many in the last number of a picture."""

_STEEP = 2
"""Pixels at the largest number over those at the next that occurs, from which on they are a pile.
Chosen: without clipping, fewer pixels have the largest number than the next one."""


def top_pile(numbers: NDArray[np.generic]) -> int | None:
    """Return the number at which pixels of a picture pile up; None if they don't.

    Without another exposure it may also be that all pixels have the same light.
    """
    flat: NDArray[Any] = numbers.reshape(-1)
    top = flat.max()
    count = int(np.count_nonzero(flat == top))
    if count < LEAST_PILE:
        return None
    rest = flat[flat != top]
    beside = int(np.count_nonzero(rest == rest.max())) if rest.size else 0
    return int(top) if count >= _STEEP * beside else None
