"""The mount of the panel before the sensor: rotation, mirroring and shift of the panel's axes.

A PSF is computed in the panel's axes on a finer and larger grid, and then resampled in the sensor's
axes. Flips and quarter turns move whole samples. The rest of the rotation evaluates the Fourier
series through the samples, because the pupil limits how fine a PSF's fringes are.

Seen from a panel that is shifted by s, the lens with its stop and its aberrations is shifted by -s.
The quadratic phase of a shifted thin lens is the same phase about the panel's middle and a prism.
To paraxial order, stop and aberrations then lie elsewhere on the panel; the light of an object
crosses the panel at another angle, which matters if the lens stands apart; and an image out of
focus moves with the panel, by s times image distance times defocus.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
import torch
from numpy.typing import NDArray

from optics.camera import Camera, Lens
from optics.camera.pupil import object_to_lens_distance
from optics.camera.stop import Circle, Point, Polygon, Shape
from optics.fourier import NonuniformTransform, fft
from optics.plane import Plane, centred_crop, origin_to_centre, origin_to_corner
from optics.validation import as_number
from optics.zernike import zernike

ZernikeTerms = tuple[tuple[int, int, float], ...]

# Coefficients below this share of the strongest one are rounding errors. Chosen.
_NEGLIGIBLE = 1e-12


def shift_aberrations(
    terms: Iterable[tuple[int, int, float]], y: float, x: float, radius: float = 1.0
) -> ZernikeTerms:
    """Return a lens' Zernike coefficients over a disc whose middle (y, x) lies beside the axis.

    Lengths are in stop radii; `radius` is the disc's. A polynomial over another disc is a sum of
    those of its degree and lower ones, found by solving at as many points as determine it, without
    its mean, which has no effect.
    """
    terms = tuple((n, m, as_number(path)) for n, m, path in terms)
    if not terms or ((y, x) == (0.0, 0.0) and radius == 1):
        return terms
    degree = max(n for n, _, _ in terms)
    names = [(n, m) for n in range(degree + 1) for m in range(-n, n + 1, 2)]
    # On so many even places along each axis, only the zero polynomial of this degree vanishes.
    places = torch.linspace(-1, 1, degree + 1, dtype=torch.float64)
    v, u = (one.reshape(-1) for one in torch.meshgrid(places, places, indexing="ij"))
    path = sum(strength * zernike(n, m, radius * v + y, radius * u + x) for n, m, strength in terms)
    assert isinstance(path, torch.Tensor)
    basis = torch.stack([zernike(n, m, v, u) for n, m in names], dim=1)
    found = torch.linalg.lstsq(basis, path[:, None]).solution[:, 0].tolist()
    least = _NEGLIGIBLE * max(abs(one) for one in found)
    return tuple(
        (n, m, one) for (n, m), one in zip(names, found, strict=True) if n and abs(one) > least
    )


Array = NDArray[np.float64]
Coordinate = TypeVar("Coordinate", float, Array)

# Samples over which a PSF fades to zero beyond its window, so that its Fourier series, which is
# periodic, has no jump at the edges. A PSF that fills the window, and has 1.05 times the samples
# that its fringes need, loses 2e-6 of its light.
_FADE_SAMPLES = 96


@dataclass(frozen=True)
class Mount:
    """How the panel is mounted before the sensor; it is mirrored first and then rotated.

    rotation: radians from x (columns) towards y (rows), by which a PSF is turned on the sensor.
    flip_x, flip_y: whether light that a pattern sends to larger x, or y, arrives at smaller x, or
    y. shift: metres (y, x) in the lens' axes from its axis to the panel's middle.
    """

    rotation: float = 0.0
    flip_x: bool = False
    flip_y: bool = False
    shift: Point = (0.0, 0.0)

    def __post_init__(self) -> None:
        if not math.isfinite(self.rotation):
            raise ValueError(f"rotation is {self.rotation:g} rad; it must be finite")
        if not all(math.isfinite(one) for one in self.shift):
            raise ValueError(f"shift is {self.shift} m; give finite lengths (y, x)")

    @property
    def is_aligned(self) -> bool:
        """Return whether panel and sensor are aligned, not mirrored or rotated."""
        return not (self.flip_x or self.flip_y or self.rotation % (2 * math.pi))

    @property
    def is_centred(self) -> bool:
        """Return whether the panel's middle lies on the lens' axis."""
        return not any(self.shift)

    @property
    def _turns(self) -> tuple[int, float]:
        """Return the rotation as the nearest number of quarter turns, and its rest in radians."""
        quarters = round(self.rotation / (math.pi / 2))
        return quarters, self.rotation - quarters * math.pi / 2

    def lens_in_panel_axes(self, lens: Lens) -> Lens:
        """Return a lens that is aligned with the sensor as seen in the panel's axes.

        Raises ValueError for a shifted panel before a lens whose phase isn't quadratic.
        """
        if not self.is_centred and lens.kind != "thin":
            raise ValueError(
                f"shift is {self.shift} m and the lens is {lens.kind}; a shift of the panel is "
                "known for thin lenses only: leave the panel on the axis"
            )
        half = as_number(lens.stop_diameter) / 2
        away = self.shift[0] / half, self.shift[1] / half
        # The opening has to lie in the disc around the new middle, which is larger.
        radius = 1 + math.hypot(*away)

        def place(point: Point) -> Point:
            y, x = ((one - middle) / radius for one, middle in zip(point, away, strict=True))
            return self._point((y, x))

        def shape(one: Shape) -> Shape:
            if isinstance(one, Polygon):
                return Polygon(tuple(place(corner) for corner in one.corners))
            return Circle(one.radius / radius, place(one.centre))

        obscurations = tuple(shape(one) for one in lens.stop.obscurations)
        stop = replace(lens.stop, opening=shape(lens.stop.opening), obscurations=obscurations)
        moved = replace(lens, aberrations=shift_aberrations(lens.aberrations, *away, radius))
        return replace(
            lens, stop=stop, aberrations=self._aberrations(moved), f_number=lens.f_number / radius
        )

    def camera_in_panel_axes(self, camera: Camera) -> Camera:
        """Return a camera with its lens as seen in the panel's axes."""
        if self.is_aligned and self.is_centred:
            return camera
        return replace(camera, lens=self.lens_in_panel_axes(camera.lens))

    def _point(self, point: Point) -> Point:
        """Transform a point (y, x) on the sensor to the panel's axes: rotate first, then mirror."""
        y, x = self.to_panel_axes(*(np.asarray(one) for one in point))
        return float(y), float(x)

    def to_panel_axes(self, y: Array, x: Array) -> tuple[Array, Array]:
        """Transform coordinates or frequencies on the sensor to the panel's axes."""
        cos, sin = math.cos(self.rotation), math.sin(self.rotation)
        y, x = y * cos - x * sin, x * cos + y * sin
        return (-y if self.flip_y else y), (-x if self.flip_x else x)

    def places_on_sensor(self, y: Coordinate, x: Coordinate) -> tuple[Coordinate, Coordinate]:
        """Transform coordinates in the panel's axes to those of the sensor."""
        y, x = (-y if self.flip_y else y), (-x if self.flip_x else x)
        cos, sin = math.cos(self.rotation), math.sin(self.rotation)
        return y * cos + x * sin, x * cos - y * sin

    def _aberrations(self, lens: Lens) -> tuple[tuple[int, int, float], ...]:
        """Return the lens' Zernike coefficients in the panel's axes.

        Rotation mixes cosine and sine terms. The panel's angle t is the lens' angle c + s t.
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

    def place_in_panel_axes(self, place: Point, camera: Camera, distance: float) -> Point:
        """Transform the place of a point's image, metres (y, x) on the sensor, to the panel's axes.

        It is the place at which a lens before the panel's middle would image the point, `distance`
        metres from the panel.
        """
        scale = camera.magnification(distance)
        y, x = (one + scale * away for one, away in zip(place, self.shift, strict=True))
        return self._point((y, x))

    def image_shift(self, camera: Camera, distance: float) -> Point:
        """Return how far the panel's shift moves the image of a point at a distance, metres (y, x).

        Every ray of a point out of focus lands beside the image by its height at the lens times
        image distance times defocus in dioptres.
        """
        lens, away = camera.lens, object_to_lens_distance(camera, distance)
        vergence = 1 / away - 1 / as_number(lens.focus_distance)
        scale = as_number(lens.image_distance) * as_number(vergence)
        return self.shift[0] * scale, self.shift[1] * scale

    def image_shift_in_panel_axes(self, camera: Camera, distance: float) -> Point:
        """Return the shift of a point's image in the panel's axes, metres (y, x)."""
        return self._point(self.image_shift(camera, distance))

    def plane_in_panel_axes(self, plane: Plane) -> Plane:
        """Return the plane in the panel's axes on which to compute a PSF for a square plane.

        It has the same number of samples on both sides of the origin.
        """
        side, (_, rest) = max(plane.shape), self._turns
        if rest:
            turned = abs(math.cos(rest)) + abs(math.sin(rest))
            side = math.ceil(side * turned) + 2 * _FADE_SAMPLES
        return replace(plane, shape=(side + 1 - side % 2,) * 2)

    def to_sensor_axes(self, psf: torch.Tensor, plane: Plane) -> torch.Tensor:
        """Resample a PSF from the panel's axes onto a plane in the sensor's axes.

        psf: a PSF on `plane_in_panel_axes(plane)`. The result is (rows, columns).
        """
        flips = [axis for axis, on in ((-2, self.flip_y), (-1, self.flip_x)) if on]
        psf = psf.flip(flips)
        quarters, rest = self._turns
        for _ in range(quarters % 4):
            psf = psf.flip(-2).mT
        if rest:
            return _resample_rotated(psf, rest, plane)
        return centred_crop(psf, plane.shape)


def _resample_rotated(psf: torch.Tensor, angle: float, plane: Plane) -> torch.Tensor:
    """Rotate a square PSF by its Fourier series, and resample it."""
    side, pitch = psf.shape[-1], plane.pitch[0]
    fading = _fading(side).to(psf)
    spectrum = origin_to_corner(psf * fading[:, None] * fading).to(torch.complex128)
    spectrum = origin_to_centre(fft(fft(spectrum, side, -1), side, -2)) / side**2
    y, x = plane.mesh()
    cos, sin = math.cos(angle), math.sin(angle)
    frequencies = Plane((side, side), (1 / (side * pitch),) * 2)
    # There are about as many points as samples; the method for few points was still measured to
    # be nearly three times faster.
    tol = 1e-6
    v, u = (y * cos - x * sin).ravel(), (x * cos + y * sin).ravel()
    series = NonuniformTransform(v, u, frequencies, 1.0, tol, few_points=True)
    return series.adjoint(spectrum).real.reshape(plane.shape).to(psf)


def _fading(side: int) -> torch.Tensor:
    """Return the window that fades a PSF to 0 at both ends of a side.

    It is 1 inside. Its ramps are those of the Vorbis window, whose spectrum decays fast.
    """
    ramp = torch.linspace(0, 1, _FADE_SAMPLES + 1, dtype=torch.float64)
    for _ in range(2):
        ramp = torch.sin(math.pi / 2 * ramp) ** 2
    fading = torch.ones(side, dtype=torch.float64)
    fading[: _FADE_SAMPLES + 1] *= ramp
    fading[-_FADE_SAMPLES - 1 :] *= ramp.flip(0)
    return fading
