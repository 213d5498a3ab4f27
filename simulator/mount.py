"""How the panel sits before the sensor: turned, mirrored, or both.

What a pattern does to a picture turns and flips with the panel, and the scene doesn't. A PSF
is known in the panel's axes on a finer and larger grid, and taken to the sensor's: by whole
samples as far as flips and quarter turns go, and for the rest by the Fourier series that goes
through its samples, because a PSF has no fringes finer than its pupil allows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from optics.camera import Lens
from optics.fourier import NonuniformTransform, fft
from optics.plane import Plane, centred_crop, origin_to_centre, origin_to_corner
from optics.stop.aperture import Circle, Point, Polygon, Shape

Array = NDArray[np.float64]

_FADE_SAMPLES = 96
"""Samples over which a PSF fades out beyond the window that is wanted: a Fourier series
repeats itself, and must not jump there. Of a PSF that fills the window, and has 1.05 times the
samples that its fringes need, 2e-6 are lost."""

_ERROR = 1e-6
"""Of the non-uniform transform, relative."""


@dataclass(frozen=True)
class Mount:
    """The panel is mirrored first, and turned then.

    rotation: radians from x (columns) towards y (rows), as a pattern's PSF is turned on the
    sensor. flip_x, flip_y: whether what a pattern sends to larger x, or y, arrives at smaller.
    """

    rotation: float = 0.0
    flip_x: bool = False
    flip_y: bool = False

    def __post_init__(self) -> None:
        if not math.isfinite(self.rotation):
            raise ValueError(f"rotation is {self.rotation:g} rad; it must be finite")

    @property
    def is_aligned(self) -> bool:
        """Whether the panel sits as if there were nothing to say about it."""
        return not (self.flip_x or self.flip_y or self.rotation % (2 * math.pi))

    @property
    def _quarters(self) -> int:
        """Quarter turns of the rotation, to the nearest."""
        return round(self.rotation / (math.pi / 2))

    @property
    def _rest(self) -> float:
        """Radians of the rotation beyond its quarter turns."""
        return self.rotation - self._quarters * math.pi / 2

    def lens_in_panel_axes(self, lens: Lens) -> Lens:
        """The lens, which stays with the sensor, in the panel's axes."""
        stop = replace(
            lens.stop,
            opening=self._shape(lens.stop.opening),
            obscurations=tuple(self._shape(shape) for shape in lens.stop.obscurations),
        )
        return replace(lens, stop=stop, aberrations=self._aberrations(lens))

    def _shape(self, shape: Shape) -> Shape:
        if isinstance(shape, Polygon):
            return Polygon(tuple(self._point(corner) for corner in shape.corners))
        return Circle(shape.radius, self._point(shape.centre))

    def _point(self, point: Point) -> Point:
        """A place (y, x) before the sensor, in the panel's axes: turned back, and mirrored."""
        y, x = self.to_panel_axes(*(np.asarray(one) for one in point))
        return float(y), float(x)

    def to_panel_axes(self, y: Array, x: Array) -> tuple[Array, Array]:
        """Places on the sensor, or frequencies of what falls on it, in the panel's axes."""
        cos, sin = math.cos(self.rotation), math.sin(self.rotation)
        y, x = y * cos - x * sin, x * cos + y * sin
        return (-y if self.flip_y else y), (-x if self.flip_x else x)

    def _aberrations(self, lens: Lens) -> tuple[tuple[int, int, float], ...]:
        """Zernike's cosines and sines of one degree and order turn into each other.

        At the panel's angle t the lens has its angle c + s t.
        """
        c = self.rotation + (math.pi if self.flip_x else 0.0)
        s = -1 if self.flip_x != self.flip_y else 1
        turned: dict[tuple[int, int], float] = {}
        for n, m, path in lens.aberrations:
            cos, sin = path * math.cos(abs(m) * c), path * math.sin(abs(m) * c)
            parts = (cos, -s * sin) if m >= 0 else (sin, s * cos)
            for order, part in zip((abs(m), -abs(m)), parts, strict=True):
                if order or m == 0:
                    turned[n, order] = turned.get((n, order), 0.0) + part
        return tuple((n, m, path) for (n, m), path in turned.items())

    def place_in_panel_axes(self, place: Point) -> Point:
        """A place (y, x) on the sensor, in the panel's axes."""
        return self._point(place)

    def plane_in_panel_axes(self, plane: Plane) -> Plane:
        """Where a PSF must be known in the panel's axes, to be known on a square plane around
        the axis in the sensor's. It has as many samples on both sides of the origin."""
        side = max(plane.shape)
        if self._rest:
            turned = abs(math.cos(self._rest)) + abs(math.sin(self._rest))
            side = math.ceil(side * turned) + 2 * _FADE_SAMPLES
        return replace(plane, shape=(side + 1 - side % 2,) * 2)

    def to_sensor_axes(self, psf: torch.Tensor, plane: Plane) -> torch.Tensor:
        """A PSF on `plane_in_panel_axes(plane)`, as the sensor has it, (rows, columns)."""
        flips = [axis for axis, on in ((-2, self.flip_y), (-1, self.flip_x)) if on]
        psf = psf.flip(flips)
        for _ in range(self._quarters % 4):
            psf = psf.flip(-2).mT
        if self._rest:
            return _resample_rotated(psf, self._rest, plane)
        return centred_crop(psf, plane.shape)


def _resample_rotated(psf: torch.Tensor, angle: float, plane: Plane) -> torch.Tensor:
    """The Fourier series of a square PSF at the samples of a plane that is turned back."""
    side, pitch = psf.shape[-1], plane.pitch[0]
    fading = _fading(side).to(psf)
    spectrum = origin_to_corner(psf * fading[:, None] * fading).to(torch.complex128)
    spectrum = origin_to_centre(fft(fft(spectrum, side, -1), side, -2)) / side**2
    y, x = plane.mesh()
    cos, sin = math.cos(angle), math.sin(angle)
    frequencies = Plane((side, side), (1 / (side * pitch),) * 2)
    # They aren't few, but not many either: its way is measured to be nearly three times quicker.
    series = NonuniformTransform(
        (y * cos - x * sin).ravel(),
        (x * cos + y * sin).ravel(),
        frequencies,
        1.0,
        _ERROR,
        few_points=True,
    )
    return series.adjoint(spectrum).real.reshape(plane.shape).to(psf)


def _fading(side: int) -> torch.Tensor:
    """One within, and smoothly down to zero at both ends: Vorbis' window, which decays fast."""
    ramp = torch.linspace(0, 1, _FADE_SAMPLES + 1, dtype=torch.float64)
    for _ in range(2):
        ramp = torch.sin(math.pi / 2 * ramp) ** 2
    fading = torch.ones(side, dtype=torch.float64)
    fading[: _FADE_SAMPLES + 1] *= ramp
    fading[-_FADE_SAMPLES - 1 :] *= ramp.flip(0)
    return fading
