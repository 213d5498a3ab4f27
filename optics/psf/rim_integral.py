"""Compute the field of a defocused thin lens as an integral along the rim of its round stop."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from optics.accuracy import require_planning_time
from optics.psf_engines.request import PSFRequest
from optics.pupil import defocus_curvature

_CHUNK = 1 << 21


def rim_node_count(q: PSFRequest, tol: float, refinement: float = 1.0) -> int:
    """Return how many evenly spaced nodes on the stop's rim a symmetric PSF needs.

    The nodes suffice for the farthest sample.
    """
    turn = refinement * q.phase_slope_bound.tilt
    # The integrand has a narrow peak if the point of the stop that is imaged onto the sample lies
    # near the rim.
    peak = 6 * math.sqrt(abs(_edge_defocus(q)))
    return math.ceil(turn + 4 * turn ** (1 / 3) + refinement * peak - 2 * math.log10(tol)) + 16


def _edge_defocus(q: PSFRequest) -> float:
    """Return the phase of the PSF's defocus at the stop's edge, in radians."""
    curvature: float = defocus_curvature(q.lens, q.distance, q.wavelength)
    return curvature * q.radius**2


def rim_field(
    q: PSFRequest, sensor: NDArray[np.float64], refinement: float = 1.0
) -> NDArray[np.complex128]:
    """Compute the symmetric PSF's field at radii on the sensor, in square stop radii, complex128.

    sensor: radii in metres. The phase is quadratic, c |r - p|², around the point p of the stop that
    is imaged geometrically onto the sample. Green's theorem turns the integral over the stop into

        U = 1/2 closed integral of g(c rho²) (rho x d rho),   g(a) = (exp(i a) - 1) / (i a),

    along the rim, with rho measured from p, up to a phase that doesn't affect the intensity. This
    is the boundary diffraction wave of Maggi and Rubinowicz, which is exact in the paraxial case.
    The number of nodes grows only with the square root of the defocus. The integral along an
    obscuration's rim is subtracted.
    """
    assert q.lens.stop.annulus_radii is not None
    c, tilt = _edge_defocus(q), 2 * math.pi * q.radius / q.scale
    count = rim_node_count(q, q.tol, refinement)
    inner, outer = q.lens.stop.annulus_radii
    field = np.zeros(sensor.size, dtype=np.complex128)
    # The integrand is symmetric about the line through the sample, so half of the rim is enough.
    half = count // 2 + 1
    angle = 2 * math.pi * np.arange(half) / (2 * (half - 1))
    weight = np.full(half, 2.0)
    weight[[0, -1]] = 1.0
    weight *= 2 * math.pi / (2 * (half - 1))
    for start in range(0, sensor.size, _CHUNK // half + 1):
        require_planning_time("the integral along the stop's rim")
        part = slice(start, start + _CHUNK // half + 1)
        middle = tilt * sensor[part, None] / (2 * c)
        for radius, sign in ((outer, 1), (inner, -1)):
            if radius == 0:
                continue
            # These forms of rho² and rho x d rho / d angle lose no digits near the rim.
            across = 2 * radius * middle * (1 - np.cos(angle))
            rho2 = (radius - middle) ** 2 + across
            turned = radius * (radius - middle) + across / 2
            field[part] += sign / 2 * ((_g(c * rho2) * turned) @ weight)
    return field


def _g(a: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Return the factor (exp(i a) - 1) / (i a) in the rim integral of a symmetric PSF.

    It is computed as exp(i a / 2) sinc(a / 2).
    """
    return np.exp(0.5j * a) * np.sinc(a / (2 * math.pi))
