"""The geometric blur of a point: rays follow the slope of the wavefront."""

from __future__ import annotations

import math
from dataclasses import replace

import torch

from optics.camera import Camera
from optics.camera.pupil import defocus_path, object_to_lens_distance, pupil_amplitude
from optics.camera.stop_areas import coverage
from optics.plane import Plane
from optics.validation import as_number
from optics.zernike import zernike


class RayOperator:
    """Compute the geometric PSF of the panel's field, as a PSFOperator does for waves.

    Parameters are those of a PSFOperator. Every panel pixel is a bundle of rays, which the slope of
    its wavefront deflects: that of panel, lens and aberrations together, interpolated between
    pixels. The light on the samples is a share of the light that leaves the pupil.
    """

    def __init__(
        self,
        camera: Camera,
        distance: float,
        wavelength: float,
        pixels: Plane,
        field: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        self.camera, self.pixels, self.wavelength = camera, pixels, wavelength
        panel, lens = camera.panel, camera.lens
        z1, z2 = as_number(camera.separation), lens.image_distance
        self._away = object_to_lens_distance(camera, distance)
        self._spread = 1 + z1 / distance
        # So many rays along an axis of a panel pixel, 16 at most, that neighbouring ones land
        # within half a sample of each other.
        vergence = abs(1 / self._away - 1 / lens.focus_distance)
        step = panel.pitch * self._spread * z2 * vergence
        k = self._finer = min(max(1, math.ceil(2 * step / min(pixels.pitch))), 16)
        # Bundles are evenly spaced in their pixel, around its centre.
        inner = -(k - 1) / 2 / k * panel.pitch
        whole = [(n * k) // 2 - (n // 2) * k for n in panel.shape]
        y, x = (
            inner + n * panel.pitch / k + z1 * place / z2
            for n, place in zip(whole, field, strict=True)
        )
        plane = replace(panel.plane.with_finer_pitch(k), centre=(y, x))
        self._y, self._x = plane.mesh()
        # For a panel apart from the lens, the stop's shadow on the panel is used.
        radius = as_number(lens.stop_diameter) / 2 / self._spread
        self._open = coverage(lens.stop, radius, plane)

    def __call__(self, phase: None, field: torch.Tensor) -> torch.Tensor:
        """Return the light on the samples, (rows, columns) float64, of a field (rows, columns)."""
        del phase
        light = (field.real**2 + field.imag**2).to(torch.float64)
        k = self._finer
        lever = as_number(self.camera.ray_matrix_b) * self.wavelength / (2 * math.pi)
        landed = []
        for axis, at in ((0, self._y), (1, self._x)):
            slope = _slopes_between_pixels(_slope(field, axis) / self.camera.panel.pitch, k)
            landed.append(slope * lever + self._ray_displacement(axis, at))
        whole = light.repeat_interleave(k, 0).repeat_interleave(k, 1)
        # Shares refer to the light from the pupil for a unit field.
        unit = pupil_amplitude(replace(self.camera, separation=0.0)).sum()
        weight = whole * self._open / (k * k * float(unit))
        return self._splat(landed[0], landed[1], weight)

    def straight(self, field: torch.Tensor | None = None) -> torch.Tensor:
        """Return the light on the samples without a pattern's phase."""
        one = torch.ones(self.camera.panel.shape, dtype=torch.complex64)
        return self(None, one if field is None else field.to(torch.complex64))

    def _ray_displacement(self, axis: int, at: torch.Tensor) -> torch.Tensor:
        """Return how far defocus and aberrations displace rays from the geometric image, metres."""
        lens, away = self.camera.lens, self._away
        share = 1e-4  # Slopes are differences over this share of the stop's radius.
        z2, radius = lens.image_distance, as_number(lens.stop_diameter) / 2
        # The places already contain the field's offset towards the middle of the lens.
        y, x = (place * self._spread for place in (self._y, self._x))
        here = at * self._spread
        if lens.kind == "thin":
            bent = here * (1 / away - 1 / lens.focus_distance)
        else:
            step, other = share * radius, x if axis == 0 else y
            ahead, behind = (
                defocus_path(lens, away, (here + sign * step) ** 2 + other**2) for sign in (1, -1)
            )
            bent = (ahead - behind) / (2 * step)
        for n, m, path in lens.aberrations:
            dy, dx = (share, 0.0) if axis == 0 else (0.0, share)
            ahead = zernike(n, m, y / radius + dy, x / radius + dx)
            behind = zernike(n, m, y / radius - dy, x / radius - dx)
            bent = bent + path * (ahead - behind) / (2 * share * radius)
        return bent * z2

    def _splat(self, y: torch.Tensor, x: torch.Tensor, weight: torch.Tensor) -> torch.Tensor:
        """Share each ray's light among the four samples around it, bilinearly by its place."""
        rows, columns = self.pixels.shape
        py, px = self.pixels.pitch
        y = ((y - self.pixels.centre[0]) / py + rows // 2).expand(weight.shape).reshape(-1)
        x = ((x - self.pixels.centre[1]) / px + columns // 2).expand(weight.shape).reshape(-1)
        weight = weight.reshape(-1)
        j, i = y.floor(), x.floor()
        v, u = y - j, x - i
        grid = torch.zeros(rows * columns, dtype=torch.float64)
        for dj, wv in ((0, 1 - v), (1, v)):
            for di, wu in ((0, 1 - u), (1, u)):
                row, column = j + dj, i + di
                inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
                index = (row * columns + column)[inside].to(torch.int64)
                grid.index_add_(0, index, (weight * wv * wu)[inside])
        return grid.reshape(rows, columns)


def _slope(field: torch.Tensor, axis: int) -> torch.Tensor:
    """Return the wavefront's slope, radians per pixel, float64.

    It is the mean of the phase steps to both neighbours, modulo a wave.
    """
    n = field.shape[axis]
    if n == 1:
        return torch.zeros(field.shape, dtype=torch.float64)
    ahead = torch.angle(field.narrow(axis, 1, n - 1) * field.narrow(axis, 0, n - 1).conj())
    ahead = ahead.to(torch.float64)
    first, last = ahead.narrow(axis, 0, 1), ahead.narrow(axis, n - 2, 1)
    return (torch.cat([first, ahead], axis) + torch.cat([ahead, last], axis)) / 2


def _slopes_between_pixels(slopes: torch.Tensor, k: int) -> torch.Tensor:
    """Interpolate slopes linearly between pixels' centres, at k places along an axis of each."""
    if k == 1:
        return slopes
    shape = (slopes.shape[0] * k, slopes.shape[1] * k)
    return torch.nn.functional.interpolate(
        slopes[None, None], shape, mode="bilinear", align_corners=False
    )[0, 0]
