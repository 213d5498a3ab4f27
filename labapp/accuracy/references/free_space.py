"""A field's way through free space, by direct sums over nodes on the plane that it leaves.

Scalar: Rayleigh and Sommerfeld's first integral (Goodman 3.5). Paraxial: Fresnel's (Goodman
4.2). Nodes are those of Gauss and Legendre in pieces between which the light may jump, and as many
as light and kernel turn in a piece.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from optics.plane import Plane

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

_CYCLES, _NODES = 6.0, 24
"""Turns that a piece may hold, and its nodes: the remainder is (e pi 6 / 96)^48, 1e-14."""

_FEWEST = 4
"""Nodes of a piece in which hardly anything turns."""

_CHUNK = 1 << 20
"""Products that are held at a time."""


@dataclass(frozen=True)
class Places:
    """Where the field is wanted: metres (y, x), at a distance from its plane, or behind it."""

    y: Real
    x: Real
    distance: float
    wavelength: float


@dataclass(frozen=True)
class Gaussian:
    """strength exp(-|(u - middle) / width|² + 2 pi i frequency (u - middle)); (y, x) in metres
    and cycles per metre."""

    strength: complex
    middle: tuple[float, float]
    frequency: tuple[float, float]
    width: float

    def factor_along(self, axis: int, where: Real) -> Complex:
        away = where - self.middle[axis]
        wave = 2j * np.pi * self.frequency[axis] * away
        return np.asarray(np.exp(wave - (away / self.width) ** 2))


@dataclass(frozen=True)
class SmoothLight:
    """A sum of Gaussians that has died away at the edges of its plane."""

    plane: Plane
    gaussians: tuple[Gaussian, ...]

    def on(self, y: Real, x: Real) -> Complex:
        parts = [
            one.strength * np.outer(one.factor_along(0, y), one.factor_along(1, x))
            for one in self.gaussians
        ]
        return np.asarray(np.sum(parts, axis=0))

    @property
    def samples(self) -> Complex:
        return self.on(*(self.plane.coordinates(axis).numpy() for axis in (0, 1)))

    def smooth_pieces(self, axis: int) -> Real:
        """The ends of pieces in which the light is smooth, (pieces, 2): the plane is one."""
        where = self.plane.coordinates(axis).numpy()
        return np.array([[where[0], where[-1]]])

    def spatial_frequency(self, axis: int) -> float:
        """Cycles per metre of the light by itself."""
        return max(abs(g.frequency[axis]) + 1 / (math.pi * g.width) for g in self.gaussians)


@dataclass(frozen=True)
class CellLight:
    """Squares of constant field around the samples of a plane, without gaps."""

    plane: Plane
    samples: Complex

    def on(self, y: Real, x: Real) -> Complex:
        rows, columns = (
            np.rint((where - self.plane.coordinates(axis).numpy()[0]) / self.plane.pitch[axis])
            for axis, where in ((0, y), (1, x))
        )
        return np.asarray(self.samples[np.ix_(rows.astype(int), columns.astype(int))])

    def smooth_pieces(self, axis: int) -> Real:
        half = self.plane.pitch[axis] / 2
        return self.plane.coordinates(axis).numpy()[:, None] + np.array([-half, half])

    def spatial_frequency(self, axis: int) -> float:
        return 0.0


Light = SmoothLight | CellLight


def exact_field(light: Light, places: Places, *, paraxial: bool) -> Complex:
    """The field at some places, without exp(ikz).

    Parameters
    ----------
    light
        The field on the plane that it leaves.
    places
        At most some hundred: every one of them takes a sum over all nodes in the scalar model.
    paraxial
        Whether Fresnel's kernel is meant, and not Rayleigh and Sommerfeld's.

    Returns
    -------
    Complex
        (places,), within about 1e-10 of the integral.
    """
    (y, wy), (x, wx) = (_quadrature_rule(light, places, axis, paraxial=paraxial) for axis in (0, 1))
    if paraxial:
        down, across = (
            _fresnel(seen[:, None] - nodes, places) * weights
            for seen, nodes, weights in ((places.y, y, wy), (places.x, x, wx))
        )
        return np.asarray(np.einsum("sk,sk->s", down @ light.on(y, x), across))
    value = np.zeros(places.y.size, dtype=np.complex128)
    rows = max(1, _CHUNK // x.size)
    for start in range(0, y.size, rows):
        part = slice(start, start + rows)
        lit = light.on(y[part], x) * np.outer(wy[part], wx)
        for number, (v, u) in enumerate(zip(places.y, places.x, strict=True)):
            value[number] += np.sum(lit * _rayleigh_sommerfeld(v - y[part, None], u - x, places))
    return value


def product_count(light: Light, places: Places, *, paraxial: bool) -> float:
    """Values of the kernel that exact_field() computes."""
    counts = [
        sum(_node_counts(light, places, axis, paraxial=paraxial))
        * light.smooth_pieces(axis).shape[0]
        for axis in (0, 1)
    ]
    return places.y.size * float(sum(counts) if paraxial else math.prod(counts))


def _quadrature_rule(
    light: Light, places: Places, axis: int, *, paraxial: bool
) -> tuple[Real, Real]:
    """Nodes and weights along an axis, as dense in all pieces as the steepest one needs."""
    pieces = light.smooth_pieces(axis)
    counts = _node_counts(light, places, axis, paraxial=paraxial)
    inside, weight = (np.concatenate(part) for part in zip(*_composite_rule(counts), strict=True))
    half = np.diff(pieces) / 2
    return (pieces.mean(axis=1)[:, None] + half * inside).ravel(), (half * weight).ravel()


def _node_counts(light: Light, places: Places, axis: int, *, paraxial: bool) -> list[int]:
    """Nodes of each panel into which every piece is cut."""
    pieces = light.smooth_pieces(axis)
    seen = (places.y, places.x)[axis]
    far = max(abs(seen.max() - pieces.min()), abs(seen.min() - pieces.max()))
    slope = far / (abs(places.distance) if paraxial else math.hypot(far, places.distance))
    cycles = float((pieces[:, 1] - pieces[:, 0]).max()) * (
        slope / places.wavelength + light.spatial_frequency(axis)
    )
    panels = math.ceil(cycles / _CYCLES)
    if isinstance(light, SmoothLight):
        panels += 6
    if panels > 1:
        return panels * [_NODES]
    count = _FEWEST
    while (math.e * math.pi * cycles / (4 * count)) ** (2 * count) > 1e-12:
        count += 1
    return [count]


def _composite_rule(counts: list[int]) -> list[tuple[Real, Real]]:
    """Nodes and weights of panels side by side, which together reach from -1 to 1."""
    found = []
    for number, count in enumerate(counts):
        nodes, weights = np.polynomial.legendre.leggauss(count)
        middle = (2 * number + 1) / len(counts) - 1
        found.append((middle + nodes / len(counts), weights / len(counts)))
    return found


def _fresnel(away: Real, places: Places) -> Complex:
    """Along one axis; of both, exp(i pi r² / (wavelength z)) / (i wavelength z)."""
    scale = places.wavelength * places.distance
    root = np.sqrt(complex(1j * scale))
    return np.asarray(np.exp(1j * np.pi / scale * away**2) / root)


def _rayleigh_sommerfeld(y: Real, x: Real, places: Places) -> Complex:
    """z / (2 pi r²) (1 / r - ik) exp(ik(r - z)); its conjugate on the way back."""
    k, far = 2 * np.pi / places.wavelength, abs(places.distance)
    squared = y**2 + x**2
    r = np.sqrt(far**2 + squared)
    # r - z, without the difference of two large numbers.
    phase = 2 * np.pi * np.remainder(squared / (r + far) / places.wavelength, 1)
    wave = far / (2 * np.pi * r**2) * (1 / r - 1j * k) * np.exp(1j * phase)
    return np.asarray(wave if places.distance > 0 else wave.conj())
