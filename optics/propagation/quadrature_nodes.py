"""How many Gauss-Legendre nodes a cell takes."""

from __future__ import annotations

import math

import numpy as np

_FAR = 1e3
"""Depth from which on the amplitude is the same all over the cell, to second order 1e-6 of
what two nodes see exactly."""

_RHO = 1 + np.geomspace(1e-3, 1e9, 300)
"""Semi-axis sums of the ellipses that are tried: any of them makes a bound."""


def gauss_nodes(turn: float, bend: float, depth: float, error: float, most: int) -> int:
    """Nodes that integrate a spherical wave over a cell to a relative error; 0 beyond `most`.

    The wave is exp(i (h x + b x²)) over |x| < 1, with |h| <= turn and |b| <= bend, radians,
    times an amplitude. depth: distance of that wave's point over half the cell's side;
    infinite if the amplitude is the same everywhere.

    The wave's amplitude has poles at ± i depth, and n nodes leave about rho^(-2n) of such a
    function, with rho = depth + sqrt(1 + depth²) (Trefethen 2008); where that is the slower,
    both add up.
    """
    slow = math.log(1 / error) / (2 * math.asinh(depth))
    if slow > most:
        return 0
    extra = math.ceil(slow) if depth < _FAR else 0
    nodes = _phase_nodes(turn, bend, error) + extra
    return nodes if nodes <= most else 0


def _phase_nodes(turn: float, bend: float, error: float) -> int:
    """Nodes for the phase alone.

    n nodes leave 32 / 15 M rho^(-2n) / (1 - rho^(-2)) of the mean of a function that is no
    larger than M on the ellipse of foci ± 1 and semi-axis sum rho (Trefethen 2008,
    10.1137/060659831). The ellipse is A cos t + i B sin t, where the wave is

        exp(-h B sin t - b A B sin 2t),

    largest where cos t = 4 b A / (h + sqrt(h² + 32 b² A²)), up to signs.
    """
    a, b = (_RHO + 1 / _RHO) / 2, (_RHO - 1 / _RHO) / 2
    root = np.hypot(turn, math.sqrt(32) * bend * a)
    cosine = 4 * bend * a / (turn + root + 1e-300)
    growth = b * np.sqrt(1 - cosine**2) * (turn + 2 * bend * a * cosine)
    wanted = growth + math.log(32 / 15 / error) - np.log1p(-(_RHO**-2.0))
    return max(math.ceil(float((wanted / (2 * np.log(_RHO))).min())), 1)
