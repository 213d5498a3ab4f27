"""Judges of free space: exact fields of a beam, of cells, and a sum over samples."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.special
from numpy.typing import NDArray

from judges.basics import positions
from judges.fields import Cells, Points
from judges.sums import Array, gauss, node_count, phasor, times
from optics.plane import Plane


@dataclass(frozen=True)
class Beam:
    """A round Gaussian exp(-(r / waist)²) on the axis, and its exact scalar field anywhere.

    Its spectrum's Hankel integral, in the angle of travelling waves and, beyond, in the decay
    of evanescent ones: neither has a root where they meet. Going back, both are conjugate or
    die as well.
    """

    waist: float

    def samples(self, plane: Plane) -> NDArray[np.complex128]:
        y, x = (positions(n, p) for n, p in zip(plane.shape, plane.pitch, strict=True))
        return np.exp(-np.add.outer(y**2, x**2) / self.waist**2).astype(complex)

    def field(self, points: Points, *, paraxial: bool) -> NDArray[np.complex128]:
        """Without exp(i k distance); all points lie at one distance."""
        assert not paraxial
        assert not points.depth.any()
        r, z, k = np.hypot(points.y, points.x), points.distance, 2 * np.pi / points.wavelength
        steepest = 2 * 6.2 / self.waist
        sine = min(steepest / k, 1.0)
        angle, weight = _from_zero(math.asin(sine), k * (abs(z) + float(r.max())))
        total = times(
            scipy.special.j0(np.outer(r, k * np.sin(angle))),
            weight
            * self._spectrum(k * np.sin(angle))
            * (k**2 * np.sin(angle) * np.cos(angle))
            * np.exp(-1j * k * z * 2 * np.sin(angle / 2) ** 2),
        )
        if steepest <= k:
            return total
        rise, weight = _from_zero(math.acosh(steepest / k), steepest * (abs(z) + float(r.max())))
        dying = times(
            scipy.special.j0(np.outer(r, k * np.cosh(rise))),
            weight
            * self._spectrum(k * np.cosh(rise))
            * (k**2 * np.cosh(rise) * np.sinh(rise))
            * np.exp(-k * abs(z) * np.sinh(rise)),
        )
        return total + np.exp(-1j * k * z) * dying

    def _spectrum(self, across: Array) -> Array:
        """Over radians a metre, with all factors of the integral over across d across J0."""
        return np.asarray(self.waist**2 / 2 * np.exp(-((across * self.waist / 2) ** 2)))


def _from_zero(end: float, turn: float) -> tuple[Array, Array]:
    """Nodes and weights from 0 to an end, for a phase that turns by so many radians a unit."""
    nodes, weights = gauss(node_count(end, turn))
    return (nodes + 1) * end / 2, weights * end / 2


@dataclass(frozen=True)
class Edges(Cells):
    """Cells whose scalar field is exact at any distance, however near: an integral along edges.

    With P the point, r its distance and phi an angle around it in the cell's plane, Rayleigh and
    Sommerfeld's integral over a cell is (A. Rubinowicz 1917, for a plane wave)

        U(P) = 1 / (2 pi) times the integral of 1 - (z / r) exp(i k (r - z)) over d phi

    around the cell's boundary: its integrand is a derivative along the radius. A piece of an
    edge that lies d away in the plane has d phi = d dt / (d² + t²), and t = d sinh(s) makes
    that smooth at any d.
    """

    def field(self, points: Points, *, paraxial: bool) -> NDArray[np.complex128]:
        if paraxial:
            return super().field(points, paraxial=True)
        k, value = 2 * np.pi / points.wavelength, np.zeros(points.y.size, dtype=complex)
        rows, columns = (self.values.any(axis=axis) for axis in (1, 0))
        middles = (
            self.plane.coordinates(0).numpy()[rows],
            self.plane.coordinates(1).numpy()[columns],
        )
        lit = self.values[np.ix_(rows, columns)]
        for number, (y, x, z) in enumerate(zip(points.y, points.x, points.z, strict=True)):
            (low_y, high_y), (low_x, high_x) = (
                (middle - side / 2 - at, middle + side / 2 - at)
                for middle, side, at in zip(middles, self.sides, (y, x), strict=True)
            )
            sent = sum(
                sign * _corner(k, abs(z), v[:, None], u)
                for sign, v, u in ((1, high_y, high_x), (-1, low_y, high_x),
                                   (-1, high_y, low_x), (1, low_y, low_x))
            )  # fmt: skip
            value[number] = np.sum(lit * (sent if z > 0 else np.conj(sent)))
        return points.turn * value


def _corner(k: float, z: float, y: Array, x: Array) -> NDArray[np.complex128]:
    """What the quarter plane from a point to a corner at (y, x) sends to it, up to its signs."""
    y, x = np.broadcast_arrays(y, x)
    return _edge(k, z, y, x) + _edge(k, z, x, y)


def _edge(k: float, z: float, away: Array, along: Array) -> NDArray[np.complex128]:
    """The integral over d phi of 1 - (z / r) exp(i k (r - z)) from 0 to `along` on an edge."""
    d = np.abs(away)
    least = np.where(d > 0, d, 1.0)
    end = np.arcsinh(np.abs(along) / least)
    r = np.sqrt(z**2 + away**2 + along**2)
    # The path is steepest at the end: its slope in s is (away² + along²)^(1/2) along / r.
    steepest = k * np.hypot(away, along) * np.abs(along) / r
    nodes, weights = gauss(node_count(2.0, float((end / 2 * (steepest + 4)).max())))
    s = end[..., None] * (nodes + 1) / 2
    rho2 = (least[..., None] * np.cosh(s)) ** 2
    r = np.sqrt(z**2 + rho2)
    turn = k * rho2 / (r + z)
    lost = rho2 / (r * (r + z)) - z / r * 2j * np.sin(turn / 2) * np.exp(0.5j * turn)
    total = np.sum(weights * lost / np.cosh(s), axis=-1) * end / 2
    sign = np.sign(away) * np.sign(along) / (2 * np.pi)
    return np.asarray(np.where(d > 0, sign * total, 0))


def direct_field(
    samples: NDArray[Any], plane: Plane, points: Points, *, paraxial: bool = False
) -> NDArray[np.complex128]:
    """The diffraction integral as a sum over samples, in extended precision.

    Rayleigh and Sommerfeld's first kernel, or Fresnel's; no node but the samples.
    """
    y, x = (
        positions(n, p, float(c)).astype(np.longdouble)
        for n, p, c in zip(plane.shape, plane.pitch, plane.centre, strict=True)
    )
    wavelength = np.longdouble(points.wavelength)
    value = np.zeros(points.y.size, dtype=complex)
    for number, (v, u, z) in enumerate(zip(points.y, points.x, points.z, strict=True)):
        rho2 = np.add.outer((y - v) ** 2, (x - u) ** 2)
        far = np.longdouble(abs(z))
        if paraxial:
            kernel = phasor(rho2 / (2 * wavelength * far) - 0.25) / float(wavelength * far)
        else:
            r = np.sqrt(far**2 + rho2)
            front = (1 / r - 2j * np.pi / wavelength) * far / (2 * np.pi * r**2)
            kernel = front.astype(complex) * phasor((r - far) / wavelength)
        value[number] = np.sum(samples * (kernel if z > 0 else kernel.conj()))
    return points.turn * value * plane.pitch[0] * plane.pitch[1]
