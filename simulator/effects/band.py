"""The filter's band: how many wavelengths stand for it."""

from __future__ import annotations

import math

from optics.pupil import cutoff_frequency
from simulator.effects.situation import Decision, Situation

_MOST_NODES = 5


def filter_bandwidth(s: Situation, tol: float) -> Decision:
    """Gauss-Hermite error a^2n n! / (2n)!, a the phase of the finest well-seen fringe.

    A change of wavelength scales the PSF; a fringe of half the cut-off frequency at the
    PSF's radius moves by a radians for one standard deviation of the band. The radius is
    at least that of the first fringes beside the spot of a neutral pattern.
    """
    sigma = s.bandwidth / 2.3548
    cutoff = cutoff_frequency(s.camera, s.wavelength)
    radius = math.hypot(s.spread, 2 / cutoff)
    a = 2 * math.pi * (cutoff / 2) * radius * sigma / s.wavelength

    def error(n: int) -> float:
        return a ** (2 * n) * math.factorial(n) / math.factorial(2 * n)

    nodes = next((n for n in range(1, _MOST_NODES) if error(n) <= tol), _MOST_NODES)
    used = "one wavelength leaves" if nodes == 1 else f"{nodes} wavelengths leave"
    why = f"the band scales the PSF; {used} an error of {error(nodes):.1g}"
    return Decision("filter bandwidth", nodes > 1, error(1), "mean", why, nodes)
