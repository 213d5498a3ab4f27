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

    camera, distance, wavelength, pixels, field: as for a PSFOperator. Every panel pixel is a bundle
    of rays, which the slope of its wavefront deflects: that of panel, lens and aberrations
    together. Between pixels the slope is interpolated. The light on the samples is a share of the
    light that leaves the pupil.
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
        self._distance, self._field = distance, field
        z1, z2 = as_number(camera.separation), camera.lens.image_distance
        self._spread = 1 + z1 / distance
        self._offset = tuple(z1 * place / z2 for place in field)
        self._finer = self._rays()
        self._open = self._stop_transmission()

    def _rays(self) -> int:
        """Return the rays along an axis of a panel pixel, at most 16.

        Neighbouring rays land within half a sample of each other, if the limit allows.
        """
        camera, away = self.camera, object_to_lens_distance(self.camera, self._distance)
        vergence = abs(1 / away - 1 / camera.lens.focus_distance)
        step = camera.panel.pitch * self._spread * camera.lens.image_distance * vergence
        return min(max(1, math.ceil(2 * step / min(self.pixels.pitch))), 16)

    def _stop_transmission(self) -> torch.Tensor:
        """Return the share of each bundle of rays that the stop lets pass.

        For a panel apart from the lens, the stop's shadow on the panel is used.
        """
        panel, lens = self.camera.panel, self.camera.lens
        radius = as_number(lens.stop_diameter) / 2 / self._spread
        # Bundles are evenly spaced in their pixel, around its centre.
        inner = -(self._finer - 1) / 2 / self._finer * panel.pitch
        whole = [(n * self._finer) // 2 - (n // 2) * self._finer for n in panel.shape]
        y, x = (
            inner + k * panel.pitch / self._finer + o
            for k, o in zip(whole, self._offset, strict=True)
        )
        plane = replace(panel.plane.with_finer_pitch(self._finer), centre=(y, x))
        self._y, self._x = plane.mesh()
        return coverage(lens.stop, radius, plane)

    def __call__(self, phase: None, field: torch.Tensor) -> torch.Tensor:
        """Return the light on the samples, (rows, columns) float64, of a field (rows, columns)."""
        del phase
        light = (field.real**2 + field.imag**2).to(torch.float64)
        k, lever = (
            self._finer,
            as_number(self.camera.ray_matrix_b) * self.wavelength / (2 * math.pi),
        )
        landed = []
        for axis, at in ((0, self._y), (1, self._x)):
            slope = _slopes_between_pixels(_slope(field, axis) / self.camera.panel.pitch, k)
            landed.append(slope * lever + self._ray_displacement(axis, at))
        whole = light.repeat_interleave(k, 0).repeat_interleave(k, 1)
        weight = whole * self._open / (k * k * float(self._straight))
        return self._splat(landed[0], landed[1], weight)

    def straight(self, field: torch.Tensor | None = None, *, keep: bool = False) -> torch.Tensor:
        """Return the light on the samples without a pattern's phase.

        keep: has no effect; it is there because a PSFOperator has it.
        """
        del keep
        one = torch.ones(self.camera.panel.shape, dtype=torch.complex64)
        return self(None, one if field is None else field.to(torch.complex64))

    @property
    def _straight(self) -> torch.Tensor:
        """Return the light from the pupil for a unit field, to which shares refer."""
        return pupil_amplitude(replace(self.camera, separation=0.0)).sum()

    def _ray_displacement(self, axis: int, at: torch.Tensor) -> torch.Tensor:
        """Return how far defocus and aberrations displace rays from the geometric image, metres."""
        lens, away = self.camera.lens, object_to_lens_distance(self.camera, self._distance)
        share = 1e-4  # Slopes are differences over this share of the stop's radius.
        z2, radius = lens.image_distance, as_number(lens.stop_diameter) / 2
        # The places already contain the field's offset towards the middle of the lens.
        y, x = (place * self._spread for place in (self._y, self._x))
        here = at * self._spread
        if lens.kind == "thin":
            bent = here * (1 / away - 1 / lens.focus_distance)
        else:
            step = share * radius
            ends = [
                (here + sign * step) ** 2 + self._other_coordinate(axis) ** 2 for sign in (1, -1)
            ]
            paths = [defocus_path(lens, away, end) for end in ends]
            bent = (paths[0] - paths[1]) / (2 * step)
        for n, m, path in lens.aberrations:
            dy, dx = (share, 0.0) if axis == 0 else (0.0, share)
            ahead = zernike(n, m, y / radius + dy, x / radius + dx)
            behind = zernike(n, m, y / radius - dy, x / radius - dx)
            bent = bent + path * (ahead - behind) / (2 * share * radius)
        return bent * z2

    def _other_coordinate(self, axis: int) -> torch.Tensor:
        """Return where rays meet the lens along the other axis, in metres."""
        return (self._x if axis == 0 else self._y) * self._spread

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
