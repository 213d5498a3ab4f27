"""Propagates a field through free space exactly, by direct sums over nodes on the source plane.

The scalar model is the first Rayleigh-Sommerfeld integral (section 3.5 of Goodman), the paraxial
one the Fresnel integral (section 4.2 of Goodman). Gauss-Legendre nodes fill the pieces in which the
field is smooth; their number follows from how far the phase of field and kernel changes in a piece.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from optics.plane import Plane

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class Places:
    """Positions at which the field is computed, and their distance from the source plane; metres.

    A negative distance goes back.
    """

    y: Real
    x: Real
    distance: float
    wavelength: float


@dataclass(frozen=True)
class Gaussian:
    """A Gaussian beam in the source plane, tilted by a spatial frequency; SI units.

    Its field is strength exp(-|(u - middle) / width|² + 2 pi i frequency (u - middle)).
    """

    strength: complex
    middle: tuple[float, float]
    frequency: tuple[float, float]
    width: float

    def factor_along(self, axis: int, where: Real) -> Complex:
        """Return the field's factor along one axis, without the strength."""
        away = where - self.middle[axis]
        wave = 2j * np.pi * self.frequency[axis] * away
        return np.asarray(np.exp(wave - (away / self.width) ** 2))


@dataclass(frozen=True)
class SmoothLight:
    """A smooth field: a sum of Gaussian beams that is negligible at the edges of its plane."""

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
        """Return the ends of the smooth pieces in metres, (pieces, 2): the whole plane is one."""
        where = self.plane.coordinates(axis).numpy()
        return np.array([[where[0], where[-1]]])

    def spatial_frequency(self, axis: int) -> float:
        """Return the highest spatial frequency along one axis, in cycles per metre."""
        return max(abs(g.frequency[axis]) + 1 / (math.pi * g.width) for g in self.gaussians)


@dataclass(frozen=True)
class CellLight:
    """A field that is constant in square cells around the samples of a plane, without gaps."""

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
    """Return the field at some places, (places,), without the factor exp(ikz).

    It is within about 1e-10 of the integral. In the scalar model each place takes a sum over all
    nodes; the paraxial one uses the Fresnel kernel.
    """
    (y, wy), (x, wx) = (_quadrature_rule(light, places, axis, paraxial=paraxial) for axis in (0, 1))
    if paraxial:
        down, across = (
            _fresnel(seen[:, None] - nodes, places) * weights
            for seen, nodes, weights in ((places.y, y, wy), (places.x, x, wx))
        )
        return np.asarray(np.einsum("sk,sk->s", down @ light.on(y, x), across))
    value = np.zeros(places.y.size, dtype=np.complex128)
    # About a million products are held in memory at a time.
    rows = max(1, (1 << 20) // x.size)
    for start in range(0, y.size, rows):
        part = slice(start, start + rows)
        lit = light.on(y[part], x) * np.outer(wy[part], wx)
        for number, (v, u) in enumerate(zip(places.y, places.x, strict=True)):
            value[number] += np.sum(lit * _rayleigh_sommerfeld(v - y[part, None], u - x, places))
    return value


def product_count(light: Light, places: Places, *, paraxial: bool) -> float:
    """Return how many kernel values are computed."""
    counts = [
        sum(_node_counts(light, places, axis, paraxial=paraxial))
        * light.smooth_pieces(axis).shape[0]
        for axis in (0, 1)
    ]
    return places.y.size * float(sum(counts) if paraxial else math.prod(counts))


def _quadrature_rule(
    light: Light, places: Places, axis: int, *, paraxial: bool
) -> tuple[Real, Real]:
    """Return quadrature nodes and weights along one axis of the source plane.

    All pieces have the density of nodes that the piece with the steepest phase needs.
    """
    pieces = light.smooth_pieces(axis)
    counts = _node_counts(light, places, axis, paraxial=paraxial)
    inside, weight = (np.concatenate(part) for part in zip(*_composite_rule(counts), strict=True))
    half = np.diff(pieces) / 2
    return (pieces.mean(axis=1)[:, None] + half * inside).ravel(), (half * weight).ravel()


def _node_counts(light: Light, places: Places, axis: int, *, paraxial: bool) -> list[int]:
    """Return the node counts of a piece's parts; every piece is cut into the same parts."""
    # A part holds at most 6 cycles and has 24 nodes, whose remainder is (e pi 6 / 96)^48, 1e-14.
    # A piece of a single part may have fewer nodes, but at least 4.
    max_cycles, full_count, least_count = 6.0, 24, 4
    pieces = light.smooth_pieces(axis)
    seen = (places.y, places.x)[axis]
    far = max(abs(seen.max() - pieces.min()), abs(seen.min() - pieces.max()))
    slope = far / (abs(places.distance) if paraxial else math.hypot(far, places.distance))
    cycles = float((pieces[:, 1] - pieces[:, 0]).max()) * (
        slope / places.wavelength + light.spatial_frequency(axis)
    )
    parts = math.ceil(cycles / max_cycles)
    if isinstance(light, SmoothLight):
        parts += 6
    if parts > 1:
        return parts * [full_count]
    count = least_count
    while (math.e * math.pi * cycles / (4 * count)) ** (2 * count) > 1e-12:
        count += 1
    return [count]


def _composite_rule(counts: list[int]) -> list[tuple[Real, Real]]:
    """Return Gauss-Legendre nodes and weights of parts of one length, which span -1 to 1."""
    found = []
    for number, count in enumerate(counts):
        nodes, weights = np.polynomial.legendre.leggauss(count)
        middle = (2 * number + 1) / len(counts) - 1
        found.append((middle + nodes / len(counts), weights / len(counts)))
    return found


def _fresnel(away: Real, places: Places) -> Complex:
    """Return one axis' factor of the kernel exp(i pi r² / (wavelength z)) / (i wavelength z)."""
    scale = places.wavelength * places.distance
    root = np.sqrt(complex(1j * scale))
    return np.asarray(np.exp(1j * np.pi / scale * away**2) / root)


def _rayleigh_sommerfeld(y: Real, x: Real, places: Places) -> Complex:
    """Return the Rayleigh-Sommerfeld kernel.

    The kernel is z / (2 pi r²) (1 / r - ik) exp(ik(r - z)), without the factor exp(ikz), or the
    conjugate of this for propagation back.
    """
    k, far = 2 * np.pi / places.wavelength, abs(places.distance)
    squared = y**2 + x**2
    r = np.sqrt(far**2 + squared)
    # r - z is computed without the difference of two large numbers, which would lose digits.
    phase = 2 * np.pi * np.remainder(squared / (r + far) / places.wavelength, 1)
    wave = far / (2 * np.pi * r**2) * (1 / r - 1j * k) * np.exp(1j * phase)
    return np.asarray(wave if places.distance > 0 else wave.conj())
