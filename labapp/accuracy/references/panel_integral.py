"""The light of the pixels of a panel at a lens behind it, for the slow chain reference.

This is the Fresnel integral from panel to lens (thesis Eq. 5.1 to 5.4). For a square pixel of one
modulation under a parabolic wave it has a closed form: the product of Fresnel integrals C + iS
along y and x. Under the exact spherical wave it is a sum over Gauss-Legendre nodes in every pixel.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.special import fresnel

from labapp.accuracy.references.lens_integral import NODE_MARGIN, sample_positions
from optics.camera import Camera, Lens
from optics.camera.stop import Circle, Shape

Array = NDArray[np.float64]
Field = NDArray[np.complex128]


@dataclass(frozen=True)
class ImagingChain:
    """A point, the camera that images it, and the position of its image on the sensor; SI units.

    distance: from the point to the panel.
    field: position (y, x) of the geometric image from the axis. In the paraxial approximation the
    object is at -field (distance + separation) / image distance.
    sphere: whether the wave of the point over the panel is the sphere of thesis Eq. 5.1, of
    amplitude distance / r; else it is a parabola of amplitude 1.
    """

    camera: Camera
    distance: float
    wavelength: float
    field: tuple[float, float] = (0.0, 0.0)
    sphere: bool = False

    @property
    def lens(self) -> Lens:
        return self.camera.lens

    @property
    def radius(self) -> float:
        return self.lens.stop_diameter / 2

    @property
    def stop_extent(self) -> float:
        """The stop's largest distance from the axis along y or x, in metres."""
        return self.radius * _shape_extent(self.lens.stop.opening)

    @property
    def shadow_magnification(self) -> float:
        """Size of the panel's shadow at the lens over that of the panel."""
        return 1 + self.camera.separation / self.distance

    def tilt(self, axis: int) -> float:
        """Return the tangent of the light's angle along an axis, at the centre of the panel."""
        return self.field[axis] / self.lens.image_distance * self.shadow_magnification

    def edges(self, axis: int) -> Array:
        """Return both edges of each panel pixel along an axis, (pixels, 2), in metres."""
        panel = self.camera.panel
        half = panel.active_side / 2
        return sample_positions(panel.plane, axis)[:, None] + np.array([-half, half])

    @property
    def nodes_per_pixel(self) -> int:
        """Gauss-Legendre nodes across a panel pixel.

        They resolve the wave on its way to the far side of the stop.
        """
        half = self.camera.panel.active_side / 2
        far = max(np.abs(self.edges(axis)).max() for axis in (0, 1))
        slope = (self.stop_extent + far) / self.camera.separation + far / self.distance
        slope += max(abs(self.tilt(axis)) for axis in (0, 1))
        return math.ceil(NODE_MARGIN * math.pi / self.wavelength * slope * half) + 8


def _shape_extent(shape: Shape) -> float:
    if isinstance(shape, Circle):
        return shape.radius + max(abs(c) for c in shape.centre)
    return max(abs(c) for corner in shape.corners for c in corner)


class ParabolicWavePixels:
    """Panel pixels of one modulation each, under a parabolic wave."""

    def __init__(self, chain: ImagingChain) -> None:
        self._chain = chain

    def source_field(self, modulation: Field) -> Field:
        """Return the modulation itself: `propagation_matrix` includes the wave of the point."""
        return modulation

    def propagation_matrix(self, axis: int, places: Array) -> Field:
        """Return every panel pixel's light at the lens, the factor of one axis, (places, pixels).

        The object is at -field (d + z1) / z2. With its wave, the Fresnel kernel has the exponent
        i pi / wavelength times (M / z1) (p - c)² + x² / z1 - (M / z1) c², where p is a position on
        the panel and c = x / M - z1 field / z2. An infinitely far object is the limit.
        """
        chain, wavelength, z1 = self._chain, self._chain.wavelength, self._chain.camera.separation
        spread = chain.shadow_magnification
        centre = (places - z1 * chain.tilt(axis)) / spread
        stretch = math.sqrt(2 * spread / (wavelength * z1))
        s, c = fresnel(stretch * (chain.edges(axis) - centre[:, None, None]))
        integral = (c[..., 1] - c[..., 0] + 1j * (s[..., 1] - s[..., 0])) / stretch
        path = (places**2 - spread * centre**2) / z1
        front = np.exp(1j * np.pi / wavelength * path) / np.sqrt(1j * wavelength * z1)
        return np.asarray(front[:, None] * integral)


class SphericalWavePixels:
    """Quadrature nodes in every panel pixel, under an exact spherical wave."""

    def __init__(self, chain: ImagingChain) -> None:
        self._chain = chain
        self._count = chain.nodes_per_pixel
        nodes, weights = np.polynomial.legendre.leggauss(self._count)
        half = chain.camera.panel.active_side / 2
        plane = chain.camera.panel.plane
        self._y, self._x = (
            (sample_positions(plane, axis)[:, None] + half * nodes).ravel() for axis in (0, 1)
        )
        self._weights = half * weights

    def source_field(self, modulation: Field) -> Field:
        """Return the wave at the nodes behind the panel, times their quadrature weights."""
        down, along = (np.tile(self._weights, n) for n in modulation.shape)
        divided = modulation.repeat(self._count, 0).repeat(self._count, 1)
        return np.asarray(divided * np.outer(down, along) * self._spherical_wave())

    def _spherical_wave(self) -> Field:
        """Return the wave at the nodes but for a common phase (thesis Eq. 5.1).

        The chief ray goes through the middle of the lens, and its direction has the sines s = field
        / z2. It meets the panel at a distance r0 = d / sqrt(1 - s²) from the point. At an offset p
        from there, r² = r0² + 2 r0 p·s + p², and therefore r - r0 = (2 p·s + p² / r0) / (1 + r /
        r0). This form loses no digits for far objects.
        """
        chain = self._chain
        down, along = (f / chain.lens.image_distance for f in chain.field)
        z1, cosine = chain.camera.separation, math.sqrt(1 - down**2 - along**2)
        y, x = self._y[:, None] + z1 * down, self._x + z1 * along
        near = cosine / chain.distance
        step = 2 * (y * down + x * along) + (y**2 + x**2) * near
        ratio = np.sqrt(1 + near * step)
        path = step / (1 + ratio)
        return np.asarray(cosine / ratio * np.exp(2j * np.pi / chain.wavelength * path))

    def propagation_matrix(self, axis: int, places: Array) -> Field:
        """Return the Fresnel kernel of one axis from every node to the lens, (places, nodes)."""
        chain, z1 = self._chain, self._chain.camera.separation
        path = (places[:, None] - (self._y, self._x)[axis]) ** 2 / z1
        kernel = np.exp(1j * np.pi / chain.wavelength * path)
        return np.asarray(kernel / np.sqrt(1j * chain.wavelength * z1))


class LowRankModulations:
    """Several modulations of a panel, each factored into two matrices of low rank where possible.

    left: (rows, ranks). parts: the columns of each modulation, there and of `apply_right_factors`.
    """

    def __init__(self, modulations: Sequence[Field]) -> None:
        pairs = [_low_rank_factors(one) for one in modulations]
        self.left = np.concatenate([left for left, _ in pairs], axis=1)
        self._right = [right for _, right in pairs]
        ends = np.cumsum([0] + [left.shape[1] for left, _ in pairs])
        self.parts = [slice(int(a), int(b)) for a, b in pairwise(ends)]

    def apply_right_factors(self, kernel: Field) -> Field:
        """Multiply a kernel, (places, columns), by the right factors: (places, ranks)."""
        return np.concatenate([kernel if r is None else kernel @ r for r in self._right], axis=1)


def _low_rank_factors(modulation: Field) -> tuple[Field, Field | None]:
    """Factor a modulation into (rows, rank) and (columns, rank); None where that saves nothing."""
    rows, columns = modulation.shape
    corner = modulation[:20, :20]
    if np.linalg.matrix_rank(corner) == min(corner.shape):
        return modulation, None
    u, s, v = np.linalg.svd(modulation, full_matrices=False)
    # Singular values below this share of the largest one are rounding.
    rank = int((s > 1e-14 * max(modulation.shape) * s[0]).sum())
    if 2 * rank > min(rows, columns):
        return modulation, None
    return u[:, :rank] * s[:rank], v[:rank].T
