"""Slow, independent ways through free space, in numpy, float64."""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import fresnel, jv

from judges.basics import positions
from optics.plane import Plane

Array = NDArray[np.float64]
Field = NDArray[np.complex128]


def lines(plane: Plane) -> tuple[Array, Array]:
    """(y, x) of a plane's samples, one line for each axis."""
    y, x = (
        positions(n, p, float(c))
        for n, p, c in zip(plane.shape, plane.pitch, plane.centre, strict=True)
    )
    return y, x


def mesh(plane: Plane) -> tuple[Array, Array]:
    """(y, x) of a plane's samples, a column and a row."""
    y, x = lines(plane)
    return y[:, None], x[None, :]


def turned(target: Plane, tilt: tuple[float, float], distance: float) -> tuple[Array, Array, Array]:
    """(y, x, z) of the samples of a plane that is turned about x, then about y, by matrices."""
    a, b = tilt
    y, x = lines(Plane(target.shape, target.pitch))
    y, x = (v.ravel() for v in np.meshgrid(y, x, indexing="ij"))
    about_x = np.array([[1, 0, 0], [0, math.cos(a), -math.sin(a)], [0, math.sin(a), math.cos(a)]])
    about_y = np.array([[math.cos(b), 0, math.sin(b)], [0, 1, 0], [-math.sin(b), 0, math.cos(b)]])
    place = about_y @ about_x @ np.stack([x, y, 0 * x])
    return place[1] + target.centre[0], place[0] + target.centre[1], place[2] + distance


def cell_matrix(
    source: Plane,
    cells: tuple[float, float],
    target: Plane,
    distance: float,
    wavelength: float,
    *,
    tilt: tuple[float, float] = (0.0, 0.0),
    nodes: int = 14,
    paraxial: bool = False,
) -> Field:
    """(target samples, source cells): Rayleigh and Sommerfeld's first integral over each cell,
    by Gauss-Legendre nodes, exp(i k distance) left out; or Fresnel's."""
    y, x, z = turned(target, tilt, distance)
    source_y, source_x = lines(source)
    inside, weight = np.polynomial.legendre.leggauss(nodes)
    total = np.zeros((y.size, source_y.size, source_x.size), dtype=complex)
    for p, wp in zip(inside * cells[0] / 2, weight * cells[0] / 2, strict=True):
        for q, wq in zip(inside * cells[1] / 2, weight * cells[1] / 2, strict=True):
            way2 = (y[:, None] - source_y - p)[:, :, None] ** 2 + (x[:, None] - source_x - q)[
                :, None, :
            ] ** 2
            kernel = _fresnel_kernel if paraxial else _sommerfeld_kernel
            total += wp * wq * kernel(way2, z[:, None, None], wavelength)
    depth = 2 * math.pi / wavelength * (z - distance)
    return (np.exp(1j * depth)[:, None, None] * total).reshape(y.size, -1)


def _sommerfeld_kernel(way2: Array, z: Array, wavelength: float) -> Field:
    k = 2 * math.pi / wavelength
    ahead = np.abs(z)
    r = np.sqrt(ahead**2 + way2)
    path = way2 / (r + ahead)
    kernel = ahead / (2 * math.pi * r**2) * (1 / r - 1j * k) * np.exp(1j * k * path)
    return np.where(z > 0, kernel, kernel.conj())


def _fresnel_kernel(way2: Array, z: Array, wavelength: float) -> Field:
    scale = wavelength * z
    return np.exp(1j * math.pi * way2 / scale) / (1j * scale)


def fresnel_line(source: Array, side: float, target: Array, scale: float) -> Field:
    """(target, source): Fresnel's integral over cells along one axis, by scipy's integrals."""
    root = math.sqrt(2 / abs(scale))
    way = target[:, None] - source
    ends = [fresnel(root * (way + sign * side / 2)) for sign in (1, -1)]
    integral = (ends[0][1] - ends[1][1]) + 1j * (ends[0][0] - ends[1][0])
    value = integral * math.sqrt(0.5) * np.exp(-0.25j * math.pi)
    return value if scale > 0 else value.conj()


def gauss(plane: Plane, waist: float, distance: float, wavelength: float) -> Field:
    """A paraxial Gaussian beam at a distance from its waist (Siegman, Lasers, 17.1)."""
    y, x = mesh(plane)
    q = 1 / (1 + 1j * distance * wavelength / (math.pi * waist**2))
    return q * np.exp(-(x**2 + y**2) * q / waist**2)


@functools.lru_cache(maxsize=4)
def _rule(nodes: int) -> tuple[Array, Array]:
    """Gauss-Legendre nodes and weights from 0 to 1."""
    node, weight = np.polynomial.legendre.leggauss(nodes)
    return (node + 1) / 2, weight / 2


def exact_gauss(
    plane: Plane, waist: float, distance: float, wavelength: float, nodes: int = 1000
) -> Field:
    """A scalar wave whose field at the waist is a Gaussian: its Hankel transform, by
    Gauss-Legendre nodes in the angle of the waves and beyond the grazing one."""
    unit, weight = _rule(nodes)
    grazing, last = 1 / wavelength, 6.4 / (math.pi * waist)
    most = min(1.0, last / grazing)
    angle = math.asin(most) * unit
    f = grazing * np.sin(angle)
    df = grazing * np.cos(angle) * math.asin(most) * weight
    phase = -2 * math.pi * distance * wavelength * f**2 / (1 + np.cos(angle))
    field = _hankel(plane, waist, f, df * np.exp(1j * phase))
    if last > grazing:
        # f² = grazing² + g²: smooth in g.
        g = math.sqrt(last**2 - grazing**2) * unit
        f = np.sqrt(grazing**2 + g**2)
        df = math.sqrt(last**2 - grazing**2) * weight * g / f
        decay = np.exp(-2 * math.pi * abs(distance) * g - 2j * math.pi * distance / wavelength)
        field = field + _hankel(plane, waist, f, df * decay)
    return field


def _hankel(plane: Plane, waist: float, f: Array, weight: Field) -> Field:
    y, x = mesh(plane)
    radius = np.sqrt(x**2 + y**2)
    spectrum = math.pi * waist**2 * np.exp(-((math.pi * waist * f) ** 2))
    waves = 2 * math.pi * f * spectrum * weight
    return np.array([np.sum(waves * jv(0, 2 * math.pi * f * r)) for r in radius.ravel()]).reshape(
        radius.shape
    )


def light(field: NDArray, area: float) -> float:
    """Of a field's samples, each of which stands for an area."""
    return float(np.sum(np.abs(field) ** 2)) * area
