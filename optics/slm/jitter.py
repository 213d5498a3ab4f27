"""Each pixel's own random phase, which takes light from the pattern and spreads it."""

from __future__ import annotations

import math


def scattered_share(jitter: float) -> float:
    """Share of the light that a normal phase error, radians rms, spreads over all directions.

    Independent pixels add their means as fields, exp(-jitter²/2) each, and the rest, which is
    1 - exp(-jitter²) of the power, as intensities: evenly, but for the envelope of one pixel
    (Ruze, Proc. IEEE 54, 633, 1966, for a correlation of one pixel).
    """
    return -math.expm1(-(jitter**2))
