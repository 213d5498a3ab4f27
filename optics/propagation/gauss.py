"""How many Gauss-Legendre nodes a cell takes."""

from __future__ import annotations

import math

_FAR = 1e3
"""Depth from which on the amplitude is the same all over the cell, to second order 1e-6 of
what two nodes see exactly."""


def gauss_nodes(half_turn: float, depth: float, error: float, most: int) -> int:
    """Nodes that integrate a spherical wave over a cell to a relative error; 0 beyond `most`.

    half_turn: radians that the wave turns from the cell's middle to its end, at most. depth:
    distance of that wave's point over half the cell's side; infinite if the
    amplitude is the same everywhere.

    n nodes leave (2 h)^(2n) (n!)^4 / ((2n + 1) ((2n)!)^3) of the mean of exp(i h x), |x| < 1
    (Abramowitz and Stegun 25.4.30). The wave's amplitude has poles at ± i depth, and n nodes
    leave about rho^(-2n) of such a function, with rho = depth + sqrt(1 + depth²) (Trefethen
    2008); where that is the slower, both add up.
    """
    slow = math.log(1 / error) / (2 * math.asinh(depth))
    if slow > most:
        return 0
    extra = math.ceil(slow) if depth < _FAR else 0
    for n in range(1, most + 1):
        log = 2 * n * math.log(2 * half_turn + 1e-300) + 4 * math.lgamma(n + 1)
        log -= math.log(2 * n + 1) + 3 * math.lgamma(2 * n + 1)
        if log < math.log(error):
            return n + extra if n + extra <= most else 0
    return 0
