"""The positions of the design grid on the sensor, and a PSF as the camera sees it there."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.fft
import torch
from numpy.typing import NDArray
from scipy import ndimage

from labapp.common.errors import UserError
from labapp.files.bench_file import BenchFile
from optics.camera import Camera
from optics.measuring.registration import Registration
from optics.retrieval.goal import RetrievalGoal

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SensorView:
    """The design grid of a retrieval goal as a sensor of `shape` (rows, columns) sees it.

    `star_diameter` is that of the star's image in sensor pixels. `is_calibrated` says whether the
    registration was measured. Raises UserError if a part of the target falls beside the sensor.
    """

    goal: RetrievalGoal
    registration: Registration
    shape: tuple[int, int]
    star_diameter: float
    is_calibrated: bool

    def __post_init__(self) -> None:
        # Parts of the target below 0.1 % of its peak may fall beside the sensor.
        lit = (self.target > 1e-3 * self.target.max()).numpy()
        if self.on_sensor[lit].all():
            return
        low, high = self.sensor_positions[lit].min(0), self.sensor_positions[lit].max(0)
        raise UserError(
            f"the target falls on rows {low[0]:.0f} to {high[0]:.0f} and columns {low[1]:.0f} to "
            f"{high[1]:.0f} of a sensor of {self.shape[0]} x {self.shape[1]} pixels. Choose a "
            "smaller one, move the star, or let more of the sensor be read."
        )

    @cached_property
    def sensor_positions(self) -> Array:
        """Sensor position (y, x) in pixels of every sample of the design grid.

        The shape is (rows, columns, 2). A sample of the far field has a grating vector in cycles
        per panel pixel, which the registration maps to the sensor.
        """
        y, x = (
            (np.arange(n) - n // 2) / self.goal.far_field_samples for n in self.goal.plane.shape
        )
        vectors = np.stack(np.broadcast_arrays(y[:, None], x[None, :]), axis=-1)
        return self.registration.to_pixels(vectors, self.goal.wavelength)

    @cached_property
    def on_sensor(self) -> NDArray[np.bool_]:
        """Whether the sensor sees each sample of the design grid, (rows, columns)."""
        y, x = self._coordinates
        return (y >= 0) & (y <= self.shape[0] - 1) & (x >= 0) & (x <= self.shape[1] - 1)

    @cached_property
    def target(self) -> torch.Tensor:
        """The target as the camera sees it, (rows, columns) float64."""
        return self.convolve_with_star(self.goal.target)

    def convolve_with_star(self, psf: torch.Tensor) -> torch.Tensor:
        """Convolve a PSF with the star's image and the pixel aperture.

        The PSF is on the design grid, and taken to be 0 beyond it. Star and aperture enter with
        their exact Fourier transforms. Negative results are set to 0.
        """
        shape = tuple(scipy.fft.next_fast_len(n + self._reach, real=True) for n in psf.shape)
        spectrum = torch.fft.rfft2(psf.to(torch.float64), s=shape)
        seen = torch.fft.irfft2(spectrum * self._transfer(shape), s=shape)
        return seen[: psf.shape[0], : psf.shape[1]].clamp(min=0).to(psf.dtype)

    def resample_picture(self, picture: Array) -> torch.Tensor:
        """Resample a picture, (rows, columns), from sensor to design grid, cubically."""
        found = ndimage.map_coordinates(picture, self._coordinates, order=3, mode="mirror")
        return torch.from_numpy(found)

    def resample_nearest(self, values: NDArray[np.float64]) -> torch.Tensor:
        """Resample sensor values, such as variances, from the nearest pixels."""
        found = ndimage.map_coordinates(values, self._coordinates, order=0, mode="nearest")
        return torch.from_numpy(found)

    @property
    def _coordinates(self) -> Array:
        return np.moveaxis(self.sensor_positions, -1, 0)

    @cached_property
    def _step(self) -> Array:
        """Steps between samples of the design grid, in sensor pixels: a matrix for both axes."""
        stretch = self.goal.wavelength / self.registration.wavelength
        return self.registration.matrix * stretch / self.goal.far_field_samples

    @property
    def _reach(self) -> int:
        """Number of samples by which star and pixel widen a PSF on each side."""
        pixels = (self.star_diameter + math.sqrt(2)) / 2
        return math.ceil(pixels * np.linalg.norm(np.linalg.inv(self._step), 2))

    def _transfer(self, shape: tuple[int, ...]) -> torch.Tensor:
        """Return the transfer function of star and pixel for an rfft2 of `shape`."""
        fy = torch.fft.fftfreq(shape[0], dtype=torch.float64)[:, None]
        fx = torch.fft.rfftfreq(shape[1], dtype=torch.float64)[None, :]
        step = np.linalg.inv(self._step)
        # gy and gx are in cycles per sensor pixel.
        gy, gx = fy * step[0, 0] + fx * step[1, 0], fy * step[0, 1] + fx * step[1, 1]
        argument = math.pi * self.star_diameter * torch.hypot(gy, gx)
        safe = torch.where(argument > 0, argument, 1.0)
        disc = torch.where(argument > 0, 2 * torch.special.bessel_j1(safe) / safe, 1.0)
        return disc * torch.sinc(gy) * torch.sinc(gx)


def build_view(
    bench: BenchFile, goal: RetrievalGoal, diameter: float, distance: float
) -> SensorView:
    """Build the view of a star through a bench's camera.

    The star's diameter and distance are in metres. The view uses the calibration's registration at
    the wavelength nearest to the goal's. Without one, it uses the camera's description.
    """
    camera, calibration = goal.camera, bench.active_calibration
    star = diameter * camera.magnification(distance) / camera.sensor.pitch
    known = [table.build() for table in calibration.registrations] if calibration else []
    if known:
        registration = min(known, key=lambda one: abs(one.wavelength - goal.wavelength))
    else:
        registration = nominal_registration(camera, goal.wavelength)
    return SensorView(goal, registration, camera.sensor.shape, star, bool(known))


def nominal_registration(camera: Camera, wavelength: float) -> Registration:
    """Return the registration by the camera's description, which stands in for a measured one.

    The axis meets the middle of the sensor, and nothing is rotated or mirrored.
    """
    scale = wavelength * camera.ray_matrix_b / camera.panel.pitch / camera.sensor.pitch
    rows, columns = camera.sensor.shape
    return Registration(
        wavelength,
        (rows // 2, columns // 2),
        scale * np.eye(2),
        np.zeros((3, 3)),
        (0.0, 0.0),
        np.zeros((0, 2)),
        np.zeros(0, dtype=bool),
    )
