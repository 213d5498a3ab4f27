"""Compute the light that the random phase errors of a panel's pixels scatter (jitter)."""

from __future__ import annotations

import math


def scattered_share(jitter: float) -> float:
    """Compute the share of light that the SLM's jitter scatters.

    jitter: a normal phase error, radians rms.

    The mean fields of independent pixels, exp(-jitter²/2) each, add coherently. The rest of the
    power, a share of 1 - exp(-jitter²), adds in intensity and is spread evenly, apart from the
    envelope of one pixel (Ruze, Proc. IEEE 54, 633, 1966, for a correlation of one pixel).
    """
    return -math.expm1(-(jitter**2))
