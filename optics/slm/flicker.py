"""Average over the panel's flicker, the ripple of its phase within a frame (thesis §3.4).

It comes from the panel's pulse-width drive.
"""

from __future__ import annotations

import math


def flicker_nodes(flicker: float, phase: float, tol: float) -> list[tuple[float, float]]:
    """Return quadrature nodes for the mean over the SLM's phase flicker: shares and factors.

    Each node is a share of time and a factor of the phase. The factors replace 1 + flicker sin.
    phase: the largest phase in radians. The rule is that of Gauss for the mean over a sine
    (Chebyshev nodes). It has as few nodes as give the mean of exp(i phase flicker sin), which is
    Bessel's J0, with an error of at most tol. The error of k nodes is 2 J_2k, which is below 2
    (half the argument)^2k / (2k)!. Raises ValueError for a phase that needs 64 nodes or more.
    """
    if flicker == 0:
        return [(1.0, 1.0)]
    swing = abs(flicker * phase)
    for count in range(1, 64):
        error = 2 * count * math.log(swing / 2 + 1e-300) - math.lgamma(2 * count + 1)
        if error <= math.log(tol / 2):
            angles = [math.pi * (2 * k + 1) / (2 * count) for k in range(count)]
            return [(1 / count, 1 + flicker * math.cos(angle)) for angle in angles]
    raise ValueError(
        f"flicker is {flicker:g} and moves the phase by {swing:.3g} rad, more than can be "
        "averaged; wrap the phase into the panel's range"
    )
