"""Zernike polynomials over a unit disc, normalised to a root mean square of one."""

from __future__ import annotations

import math

import torch

from optics.chebyshev import chebyshev_nodes, lagrange_basis
from optics.validation import accepts_numpy
from optics.zernike_order import require_zernike_indices as require_zernike_indices


@accepts_numpy
def zernike(n: int, m: int, y: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
    """Compute the Zernike polynomial Z(n, m) at points (y, x) of a pupil, also beyond the disc.

    y, x: in units of the disc's radius. n: degree, 0 or more. m: cycles around the axis, from -n
    to n in steps of two; cosines for m >= 0, sines for m < 0, of the angle from x towards y. The
    radial part is a Jacobi polynomial of r², computed by its recurrence, which stays accurate at
    any degree (Noll 1976, 10.1364/JOSA.66.000207, for the normalisation; Born and Wolf 9.2). The
    result is differentiable. Raises ValueError for an (n, m) that doesn't exist.
    """
    require_zernike_indices(n, m)
    is_mesh = y.ndim == 2 and x.ndim == 2 and y.shape[1] == 1 and x.shape[0] == 1
    # Polynomials of a degree above ten lose digits by interpolation.
    if n <= 10 and is_mesh and min(y.shape[0], x.shape[1]) > 4 * (n + 1):
        return _zernike_on_mesh(n, m, y, x)
    return _zernike_at_points(n, m, y, x)


def _zernike_on_mesh(n: int, m: int, y: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
    """Compute values on a mesh by interpolation, which is exact for a polynomial.

    It takes n + 1 products for each point of the mesh, a twentieth of the time of the recurrence.
    """
    nodes = [_nodes_among(n + 1, p) for p in (y, x)]
    values = _zernike_at_points(n, m, nodes[0][:, None], nodes[1][None, :])
    column, row = (lagrange_basis(node, p) for node, p in zip(nodes, (y, x), strict=True))
    return column @ values @ row.mT


def _nodes_among(count: int, places: torch.Tensor) -> torch.Tensor:
    """Return Chebyshev nodes for the interpolation over places.

    They reach a little beyond the unit disc at most. Farther out polynomials grow fast, and digits
    inside would be lost.
    """
    ends = places.detach().aminmax()
    low, high = (float(end.clamp(-1.2, 1.2)) for end in ends)
    if not high > low:
        low, high = -1.2, 1.2
    return (low + high) / 2 + (high - low) / 2 * torch.from_numpy(chebyshev_nodes(count))


def _zernike_at_points(n: int, m: int, y: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
    """Compute values by the recurrence, at points that broadcast."""
    order = abs(m)
    r2 = y * y + x * x
    radial = (-1) ** ((n - order) // 2) * _jacobi((n - order) // 2, order, 1 - 2 * r2)
    # r^m cos(m t) and r^m sin(m t) are computed without the angle t, which is undefined on the
    # axis.
    cosine, sine = torch.ones_like(r2), torch.zeros_like(r2)
    for _ in range(order):
        cosine, sine = cosine * x - sine * y, cosine * y + sine * x
    strength = math.sqrt((2 if m else 1) * (n + 1))
    return strength * radial * (cosine if m >= 0 else sine)


def _jacobi(degree: int, a: int, t: torch.Tensor) -> torch.Tensor:
    """Compute the Jacobi polynomial P(degree; a, 0) at t (Abramowitz and Stegun 22.7.1)."""
    before, now = torch.ones_like(t), (a + 2) * (t - 1) / 2 + a + 1
    if degree == 0:
        return before
    for k in range(2, degree + 1):
        c = 2 * k + a
        first = (c - 1) * (c * (c - 2) * t + a * a) * now
        second = 2 * (k + a - 1) * (k - 1) * c * before
        before, now = now, (first - second) / (2 * k * (k + a) * (c - 2))
    return now
