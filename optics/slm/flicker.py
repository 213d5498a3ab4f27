"""The ripple of the phase within a frame, from the panel's pulse-width drive (thesis §3.4)."""

from __future__ import annotations

import math

_MOST_NODES = 64


def flicker_nodes(flicker: float, phase: float, tol: float) -> list[tuple[float, float]]:
    """Shares of time, and factors of the phase in them, that stand for phase (1 + flicker sin).

    phase: radians, the largest there is. Time averages of light become sums: Gauss' rule for
    the mean over a sine (Chebyshev's nodes), of as few nodes as leave the mean of
    exp(i phase flicker sin), Bessel's J0, wrong by tol at most: k nodes leave 2 J_2k, which is
    below 2 (half the argument)^2k / (2k)!.
    """
    if flicker == 0:
        return [(1.0, 1.0)]
    swing = abs(flicker * phase)
    for count in range(1, _MOST_NODES):
        error = 2 * count * math.log(swing / 2 + 1e-300) - math.lgamma(2 * count + 1)
        if error <= math.log(tol / 2):
            angles = [math.pi * (2 * k + 1) / (2 * count) for k in range(count)]
            return [(1 / count, 1 + flicker * math.cos(angle)) for angle in angles]
    raise ValueError(
        f"flicker is {flicker:g} and moves the phase by {swing:.3g} rad, more than can be "
        "averaged; wrap the phase into the panel's range"
    )
