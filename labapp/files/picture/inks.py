"""Inks of a print as the colours of a screen, by plain subtraction."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

INKS_TURNED = "its inks (CMYK) were turned into red, green and blue without their profile"
"""What is said of a picture of inks."""


def inks_to_colours(paper: NDArray[Any], white: float) -> NDArray[Any]:
    """Return red, green and blue of what inks (CMYK) leave of the paper's white.

    paper: (4, rows, columns), `white` where there is no ink.
    """
    left = paper.astype(np.float64)
    return np.rint(left[:3] * left[3] / white).astype(paper.dtype)
