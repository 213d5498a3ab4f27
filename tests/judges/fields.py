"""Fields whose way through free space is known, and exact answers at a few points.

Nothing here comes from the engine. A Gaussian's field is a closed form in Fresnel's model and
an integral of its known spectrum in the scalar one; a cell's is Fresnel's integral, or
Rayleigh and Sommerfeld's over Gauss-Legendre nodes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import fresnel

from optics.plane import Plane

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

_TAIL = 6.0
"""Where exp(-t²) is left out of an integral: at 2e-16."""

_NODES, _CYCLES = 24, 6.0
"""Nodes of a panel, and the fringes that it may hold: (e pi 6 / 96)^48 is 1e-14."""

_CHUNK = 1 << 20


@dataclass(frozen=True)
class Points:
    """Places that the field is wanted at, metres. depth: beyond `distance`, of tilted targets."""

    y: Real
    x: Real
    depth: Real
    distance: float
    wavelength: float

    @property
    def z(self) -> Real:
        return self.distance + self.depth

    @property
    def turn(self) -> Complex:
        """Of the axial wave from the distance to the depth."""
        return np.asarray(np.exp(2j * np.pi * np.remainder(self.depth / self.wavelength, 1)))

    def some(self, where: slice) -> Points:
        return Points(
            self.y[where], self.x[where], self.depth[where], self.distance, self.wavelength
        )


@dataclass(frozen=True)
class Pulse:
    """exp(-alpha (u - middle)² + 2 pi i frequency (u - middle)) along an axis.

    alpha: complex, with a positive real part; its imaginary part is a lens.
    """

    middle: float
    frequency: float
    alpha: complex

    def at(self, u: Real) -> Complex:
        away = u - self.middle
        return np.asarray(np.exp(-self.alpha * away**2 + 2j * np.pi * self.frequency * away))

    @property
    def width(self) -> float:
        """Where its amplitude is 1 / e."""
        return 1 / math.sqrt(self.alpha.real)

    @property
    def fringes(self) -> float:
        """Cycles per metre from its frequency to where its spectrum is 1 / e."""
        return 1 / (math.pi * math.sqrt((1 / self.alpha).real))

    def spectrum(self, f: Real) -> Complex:
        wave = np.exp(-((np.pi * (f - self.frequency)) ** 2) / self.alpha)
        return np.asarray(np.sqrt(np.pi / self.alpha) * wave)

    def paraxial(self, u: Real, scale: Real) -> Complex:
        """Its field after wavelength times distance, by Gauss' integral over its spectrum."""
        beta = np.pi**2 / self.alpha + 1j * np.pi * scale
        away = u - self.middle
        wave = np.exp(-((np.pi * (away - scale * self.frequency)) ** 2) / beta)
        phase = self.frequency * away - scale * self.frequency**2 / 2
        strength = np.sqrt(np.pi / self.alpha) * np.sqrt(np.pi / beta)
        return np.asarray(strength * wave * np.exp(2j * np.pi * phase))


@dataclass(frozen=True)
class Gaussians:
    """A sum of tilted, lensed Gaussians: strength, and a pulse along y and along x."""

    terms: tuple[tuple[complex, Pulse, Pulse], ...]

    def samples(self, plane: Plane) -> Complex:
        y, x = (plane.coordinates(axis).numpy() for axis in (0, 1))
        return sum_of([c * np.outer(a.at(y), b.at(x)) for c, a, b in self.terms])

    def field(self, points: Points, *, paraxial: bool) -> Complex:
        if paraxial:
            scale = points.wavelength * points.z
            parts = [
                c * a.paraxial(points.y, scale) * b.paraxial(points.x, scale)
                for c, a, b in self.terms
            ]
            return points.turn * sum_of(parts)
        return sum_of([c * _scalar(a, b, points) for c, a, b in self.terms])

    def cost(self, points: Points, *, paraxial: bool) -> float:
        """Exponentials that field() takes."""
        if paraxial:
            return float(4 * len(self.terms) * points.y.size)
        return sum(
            min(spectral_cost(a, b, points), spatial_cost(a, b, points)) for _, a, b in self.terms
        )


@dataclass(frozen=True)
class Cells:
    """Rectangles of constant field around a plane's samples."""

    plane: Plane
    sides: tuple[float, float]
    values: Complex

    def samples(self, plane: Plane) -> Complex:
        return self.values

    def field(self, points: Points, *, paraxial: bool) -> Complex:
        return self._paraxial(points) if paraxial else self._scalar(points)

    def cost(self, points: Points, *, paraxial: bool) -> float:
        """Exponentials that field() takes."""
        if paraxial:
            return float(sum(self.plane.shape) * 6 * points.y.size)
        return float(points.y.size * np.prod(self.values.shape) * np.prod(self._nodes(points)))

    def _paraxial(self, points: Points) -> Complex:
        scale = points.wavelength * points.z
        sums = [self._along(axis, where, scale) for axis, where in ((0, points.y), (1, points.x))]
        return np.asarray(
            points.turn * np.einsum("sj,jk,sk->s", sums[0], self.values, sums[1], optimize=True)
        )

    def _along(self, axis: int, where: Real, scale: Real) -> Complex:
        """What a slit as wide as each cell gives at each point: (points, cells)."""
        middle, half = self.plane.coordinates(axis).numpy(), self.sides[axis] / 2
        return slit(middle - half - where[:, None], middle + half - where[:, None], scale[:, None])

    def _nodes(self, points: Points) -> tuple[int, int]:
        """Across a cell, (y, x), by how far the kernel turns across it at the most."""
        found = []
        for axis, where in ((0, points.y), (1, points.x)):
            middle = self.plane.coordinates(axis).numpy()
            far = max(abs(where.max() - middle.min()), abs(where.min() - middle.max()))
            far += self.sides[axis] / 2
            sine = far / math.hypot(far, float(np.abs(points.z).min()))
            found.append(_enough(math.pi * self.sides[axis] * sine / points.wavelength))
        return found[0], found[1]

    def _scalar(self, points: Points) -> Complex:
        grids, weights = [], []
        for axis, count in enumerate(self._nodes(points)):
            inside, weight = np.polynomial.legendre.leggauss(count)
            half = self.sides[axis] / 2
            middle = self.plane.coordinates(axis).numpy()
            grids.append((middle[:, None] + half * inside).ravel())
            weights.append(half * weight)
        (ny, nx), (wy, wx) = self.values.shape, weights

        def light(rows: slice) -> Complex:
            repeated = np.repeat(self.values, wy.size, axis=0)[rows]
            along = np.repeat(repeated, wx.size, axis=1) * np.tile(wx, nx)
            return np.asarray(along * np.tile(wy, ny)[rows, None])

        return _rayleigh_sommerfeld(grids[0], grids[1], light, points)


def _scalar(a: Pulse, b: Pulse, points: Points) -> Complex:
    """Of two pulses, by whichever integral is the shorter sum."""
    spectral = spectral_cost(a, b, points) < spatial_cost(a, b, points)
    return (by_spectrum if spectral else by_space)(a, b, points)


def sum_of(parts: list[Complex]) -> Complex:
    return np.asarray(np.sum(parts, axis=0))


def _enough(turn: float) -> int:
    """Gauss-Legendre nodes for exp(i turn t), t from -1 to 1, to 1e-10: the remainder is about
    (e turn / 4 n)^(2 n), and one more for the kernel's fall."""
    count = 2
    while (math.e * turn / (4 * count)) ** (2 * count) > 1e-10 or 4 * count < math.e * turn:
        count += 1
    return count + 1


def slit(low: Real, high: Real, scale: Real) -> Complex:
    """Fresnel's integral from low to high, metres from the point (Goodman 4.5.1).

    scale: wavelength times distance, of either sign.
    """
    stretch = np.sqrt(2 / np.abs(scale))
    (s0, c0), (s1, c1) = fresnel(stretch * low), fresnel(stretch * high)
    value = (1 - 1j) / 2 * ((c1 - c0) + 1j * (s1 - s0))
    return np.asarray(np.where(scale > 0, value, value.conj()))


def panels(low: float, high: float, cycles: float) -> tuple[Real, Real]:
    """Gauss-Legendre nodes and weights between two ends, for so many fringes between them."""
    count = math.ceil(cycles / _CYCLES) + 6
    inside, weight = np.polynomial.legendre.leggauss(_NODES)
    step = (high - low) / count
    nodes = low + step * (np.arange(count)[:, None] + (inside + 1) / 2).ravel()
    return nodes, step / 2 * np.tile(weight, count)


def _node_count(cycles: float) -> float:
    return _NODES * (cycles / _CYCLES + 6)


@dataclass(frozen=True)
class _Axis:
    """What a quadrature along an axis has to follow: from low to high, in so many fringes."""

    low: float
    high: float
    cycles: float

    @property
    def rule(self) -> tuple[Real, Real]:
        return panels(self.low, self.high, self.cycles)

    @property
    def count(self) -> float:
        return _node_count(self.cycles)


def _spectral_axes(a: Pulse, b: Pulse, points: Points) -> tuple[_Axis, _Axis]:
    """The spectrum of two pulses against a wave to each point."""
    reach = [(p.frequency, _TAIL * p.fringes) for p in (a, b)]
    steepest = math.hypot(*(abs(f) + half for f, half in reach))
    sine = min(points.wavelength * steepest, 1 - 1e-9)
    spread = points.wavelength / math.sqrt(1 - sine**2)
    far = float(np.abs(points.z).max())
    axes = []
    for (f, half), pulse, where in zip(reach, (a, b), (points.y, points.x), strict=True):
        lens = np.pi * half * abs((1 / pulse.alpha).imag)
        shift = [far * math.copysign(spread, points.distance) * (f + end) for end in (-half, half)]
        away = [where.min() - pulse.middle - max(shift), where.max() - pulse.middle - min(shift)]
        axes.append(_Axis(f - half, f + half, 2 * half * (max(map(abs, away)) + lens)))
    return axes[0], axes[1]


def _spatial_axes(a: Pulse, b: Pulse, points: Points) -> tuple[_Axis, _Axis]:
    """Two pulses against a spherical wave from each point."""
    axes = []
    for pulse, where in ((a, points.y), (b, points.x)):
        half = _TAIL * pulse.width
        far = max(abs(where.max() - pulse.middle), abs(where.min() - pulse.middle)) + half
        sine = far / math.hypot(far, float(np.abs(points.z).min()))
        lens = abs(pulse.alpha.imag) * half / np.pi
        own = abs(pulse.frequency) + lens
        cycles = 2 * half * (sine / points.wavelength + own)
        axes.append(_Axis(pulse.middle - half, pulse.middle + half, cycles))
    return axes[0], axes[1]


def spectral_cost(a: Pulse, b: Pulse, points: Points) -> float:
    """Exponentials; a product of matrices counts for a twentieth of one."""
    y, x = _spectral_axes(a, b, points)
    each = points.y.size if np.any(points.depth) else 1 + points.y.size / 20
    return y.count * x.count * each


def spatial_cost(a: Pulse, b: Pulse, points: Points) -> float:
    y, x = _spatial_axes(a, b, points)
    return y.count * x.count * points.y.size


def by_spectrum(a: Pulse, b: Pulse, points: Points) -> Complex:
    """The integral of two pulses' spectrum over all plane waves (Goodman 3.10)."""
    (fy, wy), (fx, wx) = (axis.rule for axis in _spectral_axes(a, b, points))
    ay, ax = wy * a.spectrum(fy), wx * b.spectrum(fx)
    down = np.exp(2j * np.pi * np.outer(points.y - a.middle, fy)) * ay
    across = np.exp(2j * np.pi * np.outer(points.x - b.middle, fx)) * ax
    value = np.zeros(points.y.size, dtype=np.complex128)
    rows = max(1, _CHUNK // fx.size)
    tilted = bool(np.any(points.depth))
    for start in range(0, fy.size, rows):
        part = slice(start, start + rows)
        waves = _PlaneWaves(fy[part, None], fx, points.wavelength)
        if tilted:
            for number, z in enumerate(points.z):
                value[number] += down[number, part] @ waves.after(z) @ across[number]
        else:
            product = down[:, part] @ waves.after(points.distance)
            value += np.einsum("sk,sk->s", product, across)
    return points.turn * value


class _PlaneWaves:
    """What distance does to plane waves, without exp(ikz); evanescent ones die."""

    def __init__(self, fy: Real, fx: Real, wavelength: float) -> None:
        squared = wavelength**2 * (fy**2 + fx**2)
        root = np.sqrt(np.abs(1 - squared))
        self._waves = np.where(squared < 1, squared / (1 + root), 1.0) / wavelength
        self._decay = np.where(squared < 1, 0.0, 2 * np.pi * root / wavelength)

    def after(self, z: float) -> Complex:
        turn = np.exp(-2j * np.pi * np.remainder(z * self._waves, 1))
        return np.asarray(turn * np.exp(-abs(z) * self._decay))


def by_space(a: Pulse, b: Pulse, points: Points) -> Complex:
    """Rayleigh and Sommerfeld's first integral of two pulses (Goodman 3.5)."""
    (y, wy), (x, wx) = (axis.rule for axis in _spatial_axes(a, b, points))
    down, across = wy * a.at(y), wx * b.at(x)
    return _rayleigh_sommerfeld(y, x, lambda rows: np.outer(down[rows], across), points)


def _rayleigh_sommerfeld(
    y: Real, x: Real, light: Callable[[slice], Complex], points: Points
) -> Complex:
    """The sum over nodes of weighted light (rows of y, x) times the kernel at each point."""
    value = np.zeros(points.y.size, dtype=np.complex128)
    rows = max(1, _CHUNK // x.size)
    for start in range(0, y.size, rows):
        part = slice(start, start + rows)
        lit = light(part)
        for number, z in enumerate(points.z):
            kernel = _kernel(points.y[number] - y[part, None], points.x[number] - x, z, points)
            value[number] += np.sum(kernel * lit)
    return points.turn * value


def _kernel(y: Real, x: Real, z: float, points: Points) -> Complex:
    """(1 / 2 pi) (z / r) (1 / r - ik) exp(ik(r - z)) / r; its conjugate on the way back."""
    k, far = 2 * np.pi / points.wavelength, abs(z)
    squared = y**2 + x**2
    r = np.sqrt(far**2 + squared)
    phase = 2 * np.pi * np.remainder(squared / (r + far) / points.wavelength, 1)
    wave = far / (2 * np.pi * r**2) * (1 / r - 1j * k) * np.exp(1j * phase)
    return np.asarray(wave if z > 0 else wave.conj())


def drawn(rng: np.random.Generator, light: Real, count: int) -> tuple[NDArray[np.int64], Real]:
    """Samples drawn half by their light and half evenly, and one over each one's chance."""
    if light.size <= count:
        return np.arange(light.size), np.ones(light.size)
    chance = np.full(light.size, 1 / light.size)
    if light.sum() > 0:
        chance = 0.5 * chance + 0.5 * light / light.sum()
    chosen = rng.choice(light.size, count, p=chance / chance.sum())
    return chosen, 1 / chance[chosen]
