"""Count the Gauss-Legendre nodes that a cell needs for the direct quadrature."""

from __future__ import annotations

import math

import numpy as np

_RHO = 1 + np.geomspace(1e-3, 1e9, 300)
"""Semi-axis sums of the Bernstein ellipses that are tried. Each of them gives a valid bound."""


def gauss_nodes(turn: float, bend: float, depth: float, error: float, most: int) -> int:
    """Return how many nodes propagate a cell's spherical wave; 0 for more than `most`.

    The nodes integrate a spherical wave over a cell. The wave is exp(i (h x + b x²)) over |x| < 1,
    with |h| <= turn and |b| <= bend in radians, times an amplitude. error: relative error of the
    integral. depth: distance of the wave's origin over half the cell's side; infinite if the
    amplitude is the same everywhere.

    The wave's amplitude has poles at ± i depth. The quadrature error of such a function with n
    nodes is about rho^(-2n), with rho = depth + sqrt(1 + depth²) (Trefethen 2008). The nodes for
    the amplitude are added to those for the phase.
    """
    slow = math.log(1 / error) / (2 * math.asinh(depth))
    if slow > most:
        return 0
    # From a depth of 1000 on, the amplitude counts as constant over the cell: its second-order
    # part is 1e-6, and two nodes integrate that exactly.
    extra = math.ceil(slow) if depth < 1e3 else 0
    nodes = _phase_nodes(turn, bend, error) + extra
    return nodes if nodes <= most else 0


def _phase_nodes(turn: float, bend: float, error: float) -> int:
    """Return how many Gauss-Legendre nodes the propagated wave's phase alone needs.

    The error of the mean with n nodes is at most 32 / 15 M rho^(-2n) / (1 - rho^(-2)), for a
    function that is no larger than M on the ellipse of foci ± 1 and semi-axis sum rho (Trefethen
    2008, 10.1137/060659831). On the ellipse A cos t + i B sin t, the modulus of the wave is

        exp(-h B sin t - b A B sin 2t),

    which is largest where cos t = 4 b A / (h + sqrt(h² + 32 b² A²)), up to signs.
    """
    a, b = (_RHO + 1 / _RHO) / 2, (_RHO - 1 / _RHO) / 2
    root = np.hypot(turn, math.sqrt(32) * bend * a)
    cosine = 4 * bend * a / (turn + root + 1e-300)
    growth = b * np.sqrt(1 - cosine**2) * (turn + 2 * bend * a * cosine)
    wanted = growth + math.log(32 / 15 / error) - np.log1p(-(_RHO**-2.0))
    return max(math.ceil(float((wanted / (2 * np.log(_RHO))).min())), 1)
